"""The order of tests: files that take long come first, so that none is left to one process at the end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, TypeVar

Item = TypeVar("Item", bound=Any)

SLOW = (
    "conformance/test_every_learned_policy.py",
    "integration/test_bench.py",
    "conformance/test_every_policy.py",
    "unit/bench/entries/test_cheats.py",
    "unit/bench/entries/test_entries.py",
    "conformance/test_learned_policies_with_cameras.py",
    "conformance/test_every_defense.py",
    "conformance/test_trainings_on_a_gpu.py",
    "conformance/test_every_attack.py",
    "conformance/test_environments.py",
    "integration/test_safety.py",
    "unit/bench/store/test_fingerprint.py",
    "integration/test_own_metric.py",
    "integration/test_learning_to_drive.py",
    "conformance/test_every_detector.py",
    "integration/test_isolated.py",
    "integration/test_driving.py",
    "integration/test_vector.py",
)
"""Files whose tests take most processor time together, the longest about first; `--durations` shows others."""


def slow_first(items: Sequence[Item]) -> list[Item]:
    """Return tests (pytest's items, each with its `path`) in the order in which two processes end at about one time.

    xdist gives each process one half of them, and lets who is done take from the end of the other's. So the slow files
    stand at the beginnings of both halves in turn, and quick ones follow. Tests of a file stay together.
    """
    files = [(path.as_posix(), list(group)) for path, group in groupby(items, lambda item: item.path)]
    ranked = {path: rank for path, _ in files for rank, name in enumerate(SLOW) if path.endswith(name)}
    slow = sorted((each for each in files if each[0] in ranked), key=lambda each: ranked[each[0]])
    quick = [item for path, group in files if path not in ranked for item in group]
    first, second = ([item for _, group in slow[k::2] for item in group] for k in (0, 1))
    more = min(max(len(items) // 2 - len(first), 0), len(quick))
    return first + quick[:more] + second + quick[more:]
