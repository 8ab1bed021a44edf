"""Freed memory stays with the process."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("torch")

PROGRAM = """
import resource, numpy as np
from coopsim.nn.inference.backend import keep_freed_memory
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
