"""Benchmarks say what runs and how long it took, as they go."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

_BEGAN = time.perf_counter()


@pytest.fixture(autouse=True)
def told(request: pytest.FixtureRequest) -> Iterator[None]:
    """Print the name of a benchmark before it, and the time since the start of all after it."""
    began = time.perf_counter()
    print(f"\n--- {request.node.name}", flush=True)
    yield
    now = time.perf_counter()
    print(f"    {now - began:.0f} s; {(now - _BEGAN) / 60:.1f} min in all", flush=True)
