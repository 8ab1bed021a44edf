"""The time of a profile by the part of coopsim that it was spent in."""

from __future__ import annotations

import cProfile
import pstats
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import coopsim

_ROOTS = tuple(f"{(Path(coopsim.__file__).parent.parent / name).resolve()}/" for name in ("coopsim", "envs", "agents"))
_DEEPEST = 12
_FOR_CALLERS = ("geometry", "support", "types")
"""Rooms that work for whatever calls them."""

PARTS: Mapping[str, tuple[str, ...]] = {
    "simulation (traffic, sensors, localization)": ("world", "sensors", "localization", "envs/simulated"),
    "detection": ("detection",),
    "messages (uplink, codec, channel, packing)": ("comms", "wire", "envs", "agents/policy"),
    "scoring": ("metrics",),
    "policies' own (placing received boxes)": ("agents", "tracking/delayed", "localization/odometry"),
    "fusion": ("fusion",),
    "tracking": ("tracking",),
}
"""Parts of a step, by the beginnings of paths below `coopsim`; of several, the longest counts."""


def time_by_part(profile: cProfile.Profile) -> dict[str, float]:
    """Return the share of each part in a profile; they add up to 1 with "the rest".

    The time of other libraries' functions is their callers', in proportion to the time that each call took.
    """
    found: dict[Any, Any] = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    spent: Counter[str] = Counter()
    known: dict[Any, Mapping[str, float]] = {}
    for function, (_, _, own_s, _, callers) in found.items():
        for part, share in _parts(function, callers, found, _DEEPEST, known).items():
            spent[part] += share * own_s
    total = sum(spent.values())
    return {part: spent[part] / total for part in (*PARTS, "the rest")}


def _parts(
    function: tuple[str, int, str], callers: Any, found: Mapping[Any, Any], depth: int, known: dict[Any, Any]
) -> Mapping[str, float]:
    """Return in which parts a function works, by share; `known` remembers it by function and depth."""
    if (function, depth) not in known:
        known[function, depth] = _parts_anew(function, callers, found, depth, known)
    parts: Mapping[str, float] = known[function, depth]
    return parts


def _parts_anew(
    function: tuple[str, int, str], callers: Any, found: Mapping[Any, Any], depth: int, known: dict[Any, Any]
) -> Mapping[str, float]:
    own = _part_of(function[0])
    if own:
        return {own: 1.0}
    total = sum(times[3] for times in callers.values())
    if not depth or total <= 0:
        return {"the rest": 1.0}
    shares: Counter[str] = Counter()
    for caller, times in callers.items():
        for part, share in _parts(caller, found[caller][4], found, depth - 1, known).items():
            shares[part] += share * times[3] / total
    return shares


@cache
def _part_of(path: str) -> str | None:
    """Return the part that a file belongs to; None for what works for its callers."""
    for root in _ROOTS:
        if str(Path(path).resolve()).startswith(root):
            inside = str(Path(path).resolve()).removeprefix(_ROOTS[0])
            inside = inside if root == _ROOTS[0] else f"{Path(root).name}/{inside.removeprefix(root)}"
            if inside.startswith(_FOR_CALLERS):
                return None
            fits = {start: part for part, starts in PARTS.items() for start in starts if inside.startswith(start)}
            return fits[max(fits, key=len)] if fits else "the rest"
    return None
