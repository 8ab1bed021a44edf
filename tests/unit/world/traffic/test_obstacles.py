"""Buildings, poles, trees and furniture stop a steered car, and kerbs take speed from it: cases made by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from coopsim.envs import DriveEnv
from coopsim.world.furniture import kinds
from coopsim.world.furniture.furnish import furnishing_parts
from coopsim.world.places.description import MapFurniture
from coopsim.world.places.layout import box_part, post_part
from coopsim.world.snapshot import StaticPart
from coopsim.world.traffic.fleet import STEERED, VEHICLE
from coopsim.world.traffic.obstacles import UNSPRUNG, WHEEL_RADIUS_M, Kerbs, Obstacles, low_edges, speed_over_kerb

GREY = (120, 120, 120)
SQUARE = np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])


def flat(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros(len(points))


def car(speed: float = 5.0, x: float = 0.0) -> NDArray[Any]:
    row = np.zeros(1, VEHICLE)
    row["driver"], row["length"], row["width"], row["axle_m"] = STEERED, 4.5, 1.8, 1.3
    row["speed"], row["x"] = speed, x
    return row


def met(row: NDArray[Any], outlines: list[NDArray[np.float64]], *parts: StaticPart) -> str:
    return Obstacles(outlines, parts, flat).met(row[0])


@pytest.mark.parametrize(("x", "hit"), [(5.0, ""), (2.3, ""), (2.2, "building"), (0.0, "building"), (-2.3, "")])
def test_walls_stop_what_reaches_them(x: float, hit: str) -> None:
    assert met(car(), [np.array([[x, -5.0], [x, 5.0], [x + 1e-6, 5.0]])]) == hit


def test_a_house_around_a_car_is_met_from_within_its_sides_alone() -> None:
    row = car()
    assert met(row, [SQUARE]) == ""
    row["heading"], row["x"] = math.pi / 2, 8.2
    assert met(row, [SQUARE]) == "building"


@pytest.mark.parametrize(("x", "hit"), [(2.2, "object"), (0.0, "object"), (2.5, ""), (-2.5, "")])
def test_a_pole_stops_a_car_that_it_reaches_into(x: float, hit: str) -> None:
    assert met(car(), [SQUARE], post_part("mast", np.array([x, 0.3]), 6.0)) == hit


@pytest.mark.parametrize(
    ("low", "high", "hit"), [(0.0, 0.15, ""), (0.0, 0.5, "object"), (2.0, 3.0, ""), (1.1, 3.0, "")]
)
def test_low_things_go_under_a_car_and_high_ones_over_it(low: float, high: float, hit: str) -> None:
    assert met(car(), [], box_part("bench", (1.0, -0.5, low), (1.4, 0.5, high), GREY)) == hit


def test_the_ground_decides_what_is_low() -> None:
    stone = box_part("stone", (1.0, -0.5, 1.0), (1.4, 0.5, 1.5), GREY)
    assert not len(low_edges([stone], flat)) and len(low_edges([stone], lambda points: np.ones(len(points))))


def test_of_a_tree_the_stem_stops_and_leaves_do_not() -> None:
    tree = furnishing_parts([MapFurniture("tree", (0.0, 0.0))])
    assert met(car(x=2.3), [], *tree) == "object" and met(car(x=3.0), [], *tree) == ""
    assert met(car(), [], *furnishing_parts([MapFurniture("bush", (0.0, 0.0))])) == ""


@pytest.mark.parametrize("kind", [name for name, kind in kinds.KINDS.items() if not kind.along and name != "bush"])
def test_all_furniture_at_a_point_stops_a_car(kind: str) -> None:
    assert met(car(), [], *furnishing_parts([MapFurniture(kind, (0.0, 0.0))])) == "object"


def test_the_loss_at_a_kerb_is_the_closed_form() -> None:
    left = (1 - 0.12 / WHEEL_RADIUS_M) ** 2
    wanted = math.sqrt(100 - 9.81 * 0.12 / 2) - UNSPRUNG / 4 * (1 - left) * 10
    assert speed_over_kerb(10.0, 0.12) == pytest.approx(wanted) == pytest.approx(9.80, abs=0.01)
    assert speed_over_kerb(0.5, 0.12) == 0.0
    assert speed_over_kerb(7.0, 0.0) == speed_over_kerb(7.0, -0.12) == 7.0


def test_each_wheel_mounts_a_kerb_once() -> None:
    edge = np.array([[2.0, -9.0], [9.0, -9.0], [9.0, 9.0], [2.0, 9.0]])
    kerbs, row, speeds = Kerbs([edge], lambda points: 0.12 * (points[:, 0] > 2.0)), car(8.0), []
    for x in (0.0, 0.6, 0.8, 1.5, 3.0, 3.4, 5.0):  # the front wheels are over the edge from 0.7 on, the others from 3.3
        row["x"] = x
        kerbs.slow(row[0])
        speeds.append(float(row["speed"][0]))
    twice = speed_over_kerb(speed_over_kerb(8.0, 0.12), 0.12)
    both = speed_over_kerb(speed_over_kerb(twice, 0.12), 0.12)
    assert speeds == [8.0, 8.0, twice, twice, twice, both, both]


def test_to_drive_off_a_kerb_costs_nothing() -> None:
    kerbs, row = Kerbs([SQUARE], lambda points: 0.12 * (np.abs(points) < 9).all(axis=1)), car(8.0)
    for x in (0.0, 12.0):
        row["x"] = x
        kerbs.slow(row[0])
    assert row["speed"][0] == 8.0


def test_a_car_that_drives_into_a_tree_of_a_town_is_told_so() -> None:
    env = DriveEnv(place="town", place_seed=3, vehicles=1, pedestrians=0)
    env.reset(seed=0)
    world = env.parallel.world
    row = world.fleet.rows[world.row_of("cav_0")]
    (stem, *_) = (part for part in world.static if part.name == "tree" and part.closed)
    row["x"], row["y"] = stem.vertices[:, 0].mean() - row["length"] / 2 - 0.8, stem.vertices[:, 1].mean()
    row["heading"], row["speed"] = 0.0, 10.0
    _, _, terminated, _, info = env.step(np.float32([0.0, 0.0]))
    assert terminated and info["crash"] and info["crash_object"] and not info["crash_building"]
