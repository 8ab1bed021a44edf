"""Where road users are between the rows of a log."""

from __future__ import annotations

from pathlib import Path

import log_files
import numpy as np
import pytest

from coopsim.data.logs.filling import Columns, make_log
from coopsim.data.logs.reading import read_log
from coopsim.data.logs.track_log import TrackLog


def _circle(radius_m: float = 12.0, step_s: float = 0.5, speed_m_s: float = 6.0, turn: float = 1.0) -> TrackLog:
    time_s = np.arange(0.0, 3.01, step_s)
    angle = turn * speed_m_s / radius_m * time_s
    xy = radius_m * np.column_stack([turn * np.sin(angle), turn * (1 - np.cos(angle))])
    velocity = speed_m_s * np.column_stack([np.cos(angle), np.sin(angle)])
    count = len(time_s)
    columns = Columns(
        time_s=time_s,
        id=np.zeros(count, int),
        label=np.zeros(count, np.int64),
        xy=xy,
        heading=angle,
        velocity=velocity,
    )
    return make_log("circle", "test", columns)


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_circle_is_met_between_its_rows(turn: float) -> None:
    log = _circle(turn=turn)
    for time_s in (0.1, 0.37, 1.9):
        found = log.at(time_s)
        angle = turn * 0.5 * time_s
        expected = 12 * turn * np.array([np.sin(angle), 1 - np.cos(angle)])
        np.testing.assert_allclose(found.place[0, :2], expected, atol=1e-6)
        np.testing.assert_allclose(found.heading, angle, atol=1e-6)


def test_rows_are_met_to_the_bit() -> None:
    log = _circle()
    for row, time_s in enumerate(log.time_s.tolist()):
        found = log.at(time_s)
        assert found.place[0].tolist() == log.place[row].tolist()
        assert found.heading[0] == log.heading[row]


def test_a_car_that_reverses_keeps_its_heading() -> None:
    columns = Columns(
        time_s=np.array([0.0, 1.0]),
        id=np.zeros(2, int),
        label=np.zeros(2, np.int64),
        xy=np.array([[0.0, 0.0], [-4.0, 0.0]]),
        heading=np.array([0.0, 0.0]),
    )
    found = make_log("r", "test", columns).at(0.5)
    np.testing.assert_allclose(found.place[0, :2], [-2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.heading, 0.0, atol=1e-9)


def test_braking_covers_more_way_in_the_first_half() -> None:
    columns = Columns(
        time_s=np.array([0.0, 2.0]),
        id=np.zeros(2, int),
        label=np.zeros(2, np.int64),
        xy=np.array([[0.0, 0.0], [10.0, 0.0]]),
        heading=np.zeros(2),
        velocity=np.array([[10.0, 0.0], [0.0, 0.0]]),
    )
    found = make_log("b", "test", columns).at(1.0)
    np.testing.assert_allclose(found.place[0, 0], 7.5, atol=1e-9)  # v t - a t^2 / 2 with a = 5


def test_nobody_is_there_in_gaps_and_outside_the_track(tmp_path: Path) -> None:
    log = read_log(log_files.write_pickle(tmp_path / "s.pkl", log_files.scenario()))
    assert [len(log.at(time_s)) for time_s in (-0.1, 0.0, 0.05, 0.1, 0.2, 0.3, 0.4)] == [0, 1, 1, 1, 0, 1, 0]


def test_a_part_plays_as_the_whole() -> None:
    log = _circle()
    part = log.played(0.9, 1.6)
    assert part.time_s.tolist() == [0.5, 1.0, 1.5, 2.0]
    for time_s in (0.9, 1.2, 1.6):
        np.testing.assert_array_equal(part.at(time_s).place, log.at(time_s).place)
