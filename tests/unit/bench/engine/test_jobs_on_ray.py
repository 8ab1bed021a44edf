"""What became of a job by Ray's error; a Ray of its own is in `tests/integration/test_bench.py`."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from coopsim.bench.engine.engine import _outcome


class _RayError(Exception):
    pass


class _Job:
    def died(self, how: str) -> tuple[str, str]:
        return "died", how

    def lost(self, how: str) -> tuple[str, str]:
        return "lost", how


@pytest.mark.parametrize(
    ("error", "fate"),
    [
        ("WorkerCrashedError", "died"),
        ("OutOfMemoryError", "died"),
        ("LocalRayletDiedError", "lost"),
        ("NodeDiedError", "lost"),
        ("ObjectLostError", "lost"),
    ],
)
def test_a_dead_machine_is_no_fault_of_the_job(error: str, fate: str) -> None:
    def get(reference: Any) -> Any:
        raise type(error, (_RayError,), {})

    ray = SimpleNamespace(get=get, exceptions=SimpleNamespace(RayError=_RayError))
    assert _outcome(ray, None, _Job()) == (fate, error)  # type: ignore[arg-type]
