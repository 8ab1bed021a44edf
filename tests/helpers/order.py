"""The order of tests: files that take long come first, so that none is left to one process at the end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, TypeVar

Item = TypeVar("Item", bound=Any)

SLOW = (
    "conformance/test_every_learned_policy.py",
    "integration/test_bench.py",
    "unit/bench/entries/test_cheats.py",
    "unit/bench/entries/test_entries.py",
    "conformance/test_every_policy.py",
    "conformance/test_learned_policies_with_cameras.py",
    "conformance/test_every_defense.py",
    "conformance/test_every_attack.py",
    "conformance/test_environments.py",
    "integration/test_isolated.py",
    "integration/test_safety.py",
    "integration/test_learning_to_drive.py",
    "conformance/test_every_detector.py",
    "integration/test_driving.py",
)
"""Files whose tests take most processor time together, the longest about first; `--durations` shows others."""

TRAINING = ("conformance/test_trainings_on_a_gpu.py", "integration/test_training.py", "unit/learn/", "unit/nn/")
"""Slow files, or folders, that compute with networks: they need few of the compiled kernels."""


def slow_first(items: Sequence[Item]) -> list[Item]:
    """Return tests (pytest's items, each with its `path`) in the order in which two processes end at about one time.

    xdist gives each process one half of them, and lets who is done take from the end of the other's. So slow files
    stand at the beginnings of both halves, and quick ones follow. One process begins with environments, which compile
    kernels, and the other with trainings: if both began with environments, both would compile the same. Tests of a
    file stay together.
    """
    files = [(path.as_posix(), list(group)) for path, group in groupby(items, lambda item: item.path)]
    ranked = {path: rank for path, _ in files for rank, name in enumerate(SLOW) if path.endswith(name)}
    slow = sorted((each for each in files if each[0] in ranked), key=lambda each: ranked[each[0]])
    trains = {path for path, _ in files if any(f"/{name}" in path for name in TRAINING)} - ranked.keys()
    first = [item for _, group in slow for item in group]
    second = [item for path, group in files if path in trains for item in group]
    quick = [item for path, group in files if path not in ranked and path not in trains for item in group]
    more = min(max(len(items) // 2 - len(first), 0), len(quick))
    return first + quick[:more] + second + quick[more:]
