"""What tests of trainings share."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def no_curves(without_curves: None) -> None:
    """Let trainings draw no curves: the tests here read none."""
