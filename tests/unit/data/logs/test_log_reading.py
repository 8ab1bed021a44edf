"""Logs of every format become the same tracks."""

from __future__ import annotations

import os
from pathlib import Path

import log_files
import numpy as np
import pytest

from coopsim.data.logs.reading import read_log
from coopsim.types.taxonomy import ObjectClass

DATA = os.environ.get("COOPSIM_DATA")
needs_logs = pytest.mark.skipif(
    DATA is None or not Path(DATA, "maps", "logs").is_dir(), reason="needs COOPSIM_DATA with maps/logs"
)


def test_plain_table_has_all_as_given(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(log_files.TABLE)
    log = read_log(tmp_path / "a.csv")
    assert log.ids == ("a", "walker")
    assert log.label.tolist() == [ObjectClass.CAR, ObjectClass.PEDESTRIAN]
    assert log.size.tolist() == [[4.2, 1.8, 1.5], [0.5, 0.6, 1.8]]
    assert log.step_s == 0.1
    np.testing.assert_allclose(log.velocity[:4], [[10, 0]] * 4)
    assert log.filled == ("no velocities: from the positions before and after",)


def test_plain_table_without_more_than_places_is_filled_by_named_rules(tmp_path: Path) -> None:
    rows = ["time_s,id,x_m,y_m", "0,1,0,0", "1,1,0,5", "2,1,0,5.01", "3,1,-5,5"]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    log = read_log(tmp_path / "a.csv")
    np.testing.assert_allclose(np.sin(log.heading), [1.0, 0.0, 0.0, 0.0], atol=0.01)
    assert [text.split(":")[0] for text in log.filled] == ["no sizes", "no headings", "no velocities"]


def test_floating_cars_are_moved_back_from_their_fronts_and_turned_from_north(tmp_path: Path) -> None:
    log = read_log(log_files.write_gzip(tmp_path / "a.fcd.xml.gz", log_files.FLOATING))
    assert log.ids == ("b", "p", "x")
    assert log.label.tolist() == [ObjectClass.BUS, ObjectClass.PEDESTRIAN, ObjectClass.CAR]
    np.testing.assert_allclose(log.place[:, :2], [[0, 44], [3, 4.3], [7.5, 0], [8.5, 0]], atol=1e-9)
    np.testing.assert_allclose(log.heading, [np.pi / 2, -np.pi / 2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(log.velocity, [[0, 0], [0, -1], [10, 0], [10, 0]], atol=1e-12)


def test_parquet_of_floating_cars_equals_xml(tmp_path: Path) -> None:
    columns = {"timestep_time": [10.0, 10.1], "vehicle_id": ["x", "x"], "vehicle_x": [10.0, 11.0]}
    columns |= {"vehicle_y": [0.0, 0.0], "vehicle_angle": [90.0, 90.0], "vehicle_speed": [10.0, 10.0]}
    columns |= {"vehicle_type": ["passenger", "passenger"]}
    log = read_log(log_files.write_parquet(tmp_path / "a.parquet", columns))
    (tmp_path / "a.fcd.xml").write_text(log_files.FLOATING)
    other = read_log(tmp_path / "a.fcd.xml").of(np.array([2]))
    for name in ("time_s", "place", "heading", "velocity", "size"):
        np.testing.assert_array_equal(getattr(log, name), getattr(other, name))


def test_interaction_reads_one_case_and_tells_riders_by_their_speed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(log_files.INTERACTION)
    log = read_log(tmp_path / "a.csv")
    assert log.ids == ("1", "P1", "P2")
    assert log.label.tolist() == [ObjectClass.CAR, ObjectClass.BICYCLE, ObjectClass.PEDESTRIAN]
    assert log.size[0].tolist() == [4.0, 2.0, 1.5]
    assert log.left_out == {"rows of other cases": 1}
    second = read_log(tmp_path / "a.csv", "2")
    assert second.place[0, 0] == 70.0


def test_level_x_has_degrees_and_people_without_size(tmp_path: Path) -> None:
    log = read_log(log_files.write_level_x(tmp_path, log_files.IND))
    assert log.label.tolist() == [ObjectClass.TRUCK, ObjectClass.PEDESTRIAN]
    assert log.time_s[:2].tolist() == [1.0, 1.04]
    np.testing.assert_allclose(log.heading[:2], np.pi / 2)
    np.testing.assert_allclose(log.size, [[4.4, 1.8, 3.2], [0.6, 0.6, 1.7]])


def test_high_d_has_corners_and_y_down(tmp_path: Path) -> None:
    log = read_log(log_files.write_level_x(tmp_path, log_files.HIGHD))
    np.testing.assert_allclose(log.place[0], [102.0, -21.0, 0.0])
    np.testing.assert_allclose(log.velocity[0], [-30.0, -0.5])
    np.testing.assert_allclose(np.abs(log.heading), np.pi)
    np.testing.assert_allclose(log.size[0, :2], [4.0, 2.0])


def test_forecasting_scenario_leaves_static_objects_out_and_knows_its_car(tmp_path: Path) -> None:
    log = read_log(log_files.write_parquet(tmp_path / "scenario.parquet", log_files.forecast_columns()))
    assert log.ids == ("AV",)
    assert log.owner == 0
    assert log.left_out == {"rows of what is no road user": 2}


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_scenario_net_keeps_gaps_and_stands_on_the_ground(tmp_path: Path, protocol: int) -> None:
    log = read_log(log_files.write_pickle(tmp_path / "s.pkl", log_files.scenario(), protocol))
    assert log.ids == ("17",)
    assert log.owner == 0
    np.testing.assert_allclose(log.place[:, 2], 100.0)
    assert log.time_s.tolist() == pytest.approx([0.0, 0.1, 0.3])
    assert log.gap.tolist() == [False, True, False]


@needs_logs
@pytest.mark.parametrize(("name", "users"), [("0.pkl", 19), ("1.pkl", 163), ("cologne8.fcd.xml.gz", 46)])
def test_logs_of_others_are_read(name: str, users: int) -> None:
    log = read_log(Path(DATA or "", "maps", "logs", name))
    assert len(log.ids) == users
    assert 0.099 < log.step_s < 0.101
