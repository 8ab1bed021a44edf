"""Errors name what was probably meant, and not more."""

from __future__ import annotations

import pytest

from coopsim.errors import UnknownNameError, close_names

OPTIONS = ("budget_bytes", "buses", "dt_s", "latency_s", "latency_jitter_s", "lidar", "trucks", "vehicles")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("budgt_bytes", ["budget_bytes"]),
        ("budget", ["budget_bytes"]),
        ("latency", ["latency_s"]),
        ("lidr", ["lidar"]),
        ("vehicels", ["vehicles"]),
        ("weather", []),
        (7, []),
    ],
)
def test_close_names_alone_are_suggested(typed: object, meant: list[str]) -> None:
    assert close_names(typed, OPTIONS) == meant


def test_at_most_three_are_suggested_and_all_are_listed_where_none_is_close() -> None:
    many = [f"sensor_{k:02}" for k in range(20)]
    assert len(close_names("sensor", many)) == 3
    assert "Accepted" not in str(UnknownNameError("option", "sensor_0", many))
    assert "Did you mean" not in str(UnknownNameError("option", "weather", many))
    assert str(UnknownNameError("option", "weather", many)).endswith("sensor_18, sensor_19")
