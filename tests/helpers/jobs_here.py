"""An engine's jobs in the process of the tests, for tests that are not about processes: to start one takes seconds."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

RUN_LOCALLY = "coopsim.bench.engine.engine.run_locally"


def run_here(jobs: Iterator[Any], workers: int) -> Generator[Any]:
    """Run jobs one after the other, and yield their outcomes."""
    yield from (job.run() for job in jobs)


@contextmanager
def no_workers() -> Iterator[None]:
    """Let engines run their jobs in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RUN_LOCALLY, run_here)
        yield


@pytest.fixture
def jobs_here() -> Iterator[None]:
    """Let engines run their jobs in this process while a test runs."""
    with no_workers():
        yield
