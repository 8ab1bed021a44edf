"""The arithmetic of networks, as a setting of the process, and a watch on the weights that are loaded, without torch.

A network multiplies in float32, or in bfloat16, which is quicker where the processor or GPU has it. Everything else
(geometry, tracking, scores) is float32 or float64 always. The setting is the environment variable `COOPSIM_PRECISION`,
so worker processes have that of the process that started them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
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


_FOUND: ContextVar[dict[Path, str] | None] = ContextVar("found", default=None)


@contextmanager
def watch_weights() -> Iterator[dict[Path, str]]:
    """Collect the weights that are looked up within the block, by this thread: their files, and their names."""
    found = dict[Path, str]()
    before = _FOUND.set(found)
    try:
        yield found
    finally:
        _FOUND.reset(before)


def note_weights(name_or_path: str | Path, path: Path) -> Path:
    """Tell the watching block, if there is one, that weights are looked up. Return the path of their file.

    The library looks up by path what was found by name, so the first name of a file counts.
    """
    found = _FOUND.get()
    if found is not None:
        found.setdefault(path, str(name_or_path))
    return path
