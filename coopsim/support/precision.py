"""The arithmetic of networks, as a setting of the process; asking for it does not load torch.

A network multiplies in float32, or in bfloat16, which is quicker where the processor or GPU has it. Everything else
(geometry, tracking, scores) is float32 or float64 always. The setting is the environment variable `COOPSIM_PRECISION`,
so worker processes have that of the process that started them.
"""

from __future__ import annotations

import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from coopsim.support.checks import require_choice

PRECISION = "COOPSIM_PRECISION"
"""The environment variable."""

PRECISIONS = ("auto", "float32", "bfloat16")
"""Its values. "auto", which is the default: bfloat16 where the processor, or the GPU, multiplies it itself."""

_LINUX, _FLAGS = Path("/proc/cpuinfo"), {"avx512_bf16", "amx_tile"}
"""Where Linux describes the processor, and what it calls its means of multiplying bfloat16."""


def set_precision(precision: str) -> None:
    """Set the arithmetic of networks that are made from now on, in this process and in workers that it starts.

    Args:
        precision: "float32", "bfloat16" or "auto". A processor without bfloat16 imitates it, slowly.

    Raises:
        InvalidValueError: it is none of these.
    """
    require_choice("precision", precision, PRECISIONS)
    os.environ[PRECISION] = precision


def precision() -> str:
    """Return the setting; `COOPSIM_PRECISION` that is not set, or empty, is "auto"."""
    found = os.environ.get(PRECISION) or "auto"
    require_choice(PRECISION, found, PRECISIONS)
    return found


def arithmetic() -> str:
    """Return the arithmetic of networks on this processor, by the setting: "float32" or "bfloat16".

    Raises:
        InvalidValueError: the environment variable has a value that is not accepted.
    """
    chosen = precision()
    if chosen == "auto":
        return "bfloat16" if multiplies_bfloat16() else "float32"
    return chosen


@cache
def multiplies_bfloat16() -> bool:
    """Return whether this processor multiplies bfloat16 itself; one that does not is slower with it."""
    if _LINUX.is_file():
        lines = _LINUX.read_text(errors="replace").splitlines()
        return any(not _FLAGS.isdisjoint(line.split()) for line in lines if line.startswith("flags"))
    if find_spec("torch") is None:
        return False
    import torch

    checks = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")
    return any(bool(getattr(torch.cpu, check, bool)()) for check in checks)
