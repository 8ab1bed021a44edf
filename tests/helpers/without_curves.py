"""Trainings that draw no curves at their end: a chart takes longer than a tiny training."""

from __future__ import annotations

import sys

import pytest


@pytest.fixture
def without_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let trainings in this process draw no curves, for tests that read none.

    Tests of the log draw theirs by themselves; those of whole trainings and of the command line see the file.
    """
    if (train := sys.modules.get("coopsim.learn.train")) is not None:  # who trains has imported it
        monkeypatch.setattr(train, "write_curves", lambda folder: folder)
