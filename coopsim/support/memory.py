"""Memory that the process has freed: kept for the next allocation, or given back to the system.

Both are settings of glibc; elsewhere they do nothing.
"""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`."""


def keep_freed_memory(most_bytes: int = 2**28) -> bool:
    """Let the C library keep freed memory for the next allocation, up to `most_bytes`, for the whole process.

    By default glibc gives arrays of megabytes back to the system as soon as they are freed, and a network asks for the
    same ones again in each layer and frame: a third of the time of a small network on a processor is spent there.
    Return False if the C library has no such setting: only glibc has.
    """
    mallopt = _of_glibc("mallopt")
    if mallopt is None:
        return False
    # Some releases refuse more than 32 MiB for what is asked of the system apart.
    kept = mallopt(_MMAP_THRESHOLD, most_bytes) or mallopt(_MMAP_THRESHOLD, 2**25)
    return bool(kept) and bool(mallopt(_TRIM_THRESHOLD, most_bytes))


def release_freed_memory() -> None:
    """Collect garbage, and give what the process has freed back to the system.

    Objects that refer to each other pile up until a collection by chance. What is freed lies between what is not, and
    a process that runs one episode after another grows by it: a worker to three times of what it holds. Libraries that
    are loaded by the first call stay: no later one looks through them, which took a fifth of a short episode's time.
    """
    gc.collect()
    if not gc.get_freeze_count():
        gc.freeze()
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(0)


def _of_glibc(name: str) -> Callable[..., int] | None:
    """Return a function of the C library; None if it has none of this name, as those other than glibc."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        found: Callable[..., int] = getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError):
        return None
    return found
