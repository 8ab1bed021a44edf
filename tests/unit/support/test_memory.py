"""Freed memory stays with the process until it is released."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import resource, numpy as np
from coopsim.support.memory import keep_freed_memory
kept = keep_freed_memory()
for _ in range(3): np.ones(8 * 2**20 // 8)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20): np.ones(8 * 2**20 // 8)
print(kept, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's alone")
def test_arrays_are_made_in_memory_that_is_there_already() -> None:
    """An array of 8 MB has 2,048 pages, each of which the system would have to provide again."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    kept, faults = done.stdout.split()
    assert kept == "False" or int(faults) < 2048


RELEASED = """
import psutil, numpy as np
from coopsim.support.memory import keep_freed_memory, release_freed_memory
kept, process = keep_freed_memory(), psutil.Process()
arrays = [np.ones(2**17) for _ in range(200)]
del arrays
before = process.memory_info().rss
release_freed_memory()
print(kept, (before - process.memory_info().rss) // 2**20)
import gc
later = [[] for _ in range(100)]
release_freed_memory()
print(gc.get_freeze_count() > 1000, any(each is later for each in gc.get_objects()))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's alone")
def test_kept_memory_is_released_on_request() -> None:
    """200 arrays of 1 MB are below the limit of what is kept. What is loaded is looked through once, the new again."""
    done = subprocess.run([sys.executable, "-c", RELEASED], capture_output=True, text=True, check=True)
    kept, released_mb, loaded_is_frozen, new_is_looked_through = done.stdout.split()
    assert kept == "False" or int(released_mb) > 150
    assert (loaded_is_frozen, new_is_looked_through) == ("True", "True")
