"""Freed memory that stays with the process."""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`."""


def keep_freed_memory(most_bytes: int = 2**28) -> bool:
    """Let the C library keep freed memory for the next allocation, up to `most_bytes`, for the whole process.

    By default glibc gives arrays of megabytes back to the system as soon as they are freed, and a network asks for the
    same ones again in each layer and frame: a third of the time of a small network on a processor is spent there.

    Returns:
        Whether the C library can be told so: glibc can, others are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    # Some releases refuse more than 32 MiB for what is asked of the system apart.
    kept = mallopt(_MMAP_THRESHOLD, most_bytes) or mallopt(_MMAP_THRESHOLD, 2**25)
    return bool(kept) and bool(mallopt(_TRIM_THRESHOLD, most_bytes))
