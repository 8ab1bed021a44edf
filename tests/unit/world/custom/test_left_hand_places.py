"""Described places with traffic on the left: loops, lines and furniture are on the other side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.furniture.furnish import furnish
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import CircularLane
from coopsim.world.scenario import Place, make_scenario
from coopsim.world.world import World

NODES = {"a": [0.0, -2.0], "b": [120.0, -2.0], "c": [120.0, 2.0], "d": [0.0, 2.0]}
LONG = {
    side: {name: [5 * x, sign * y] for name, (x, y) in NODES.items()} for side, sign in (("right", 1), ("left", -1))
}
PAVEMENTS = {"w": [0.0, -7.0], "x": [120.0, -7.0], "y": [0.0, 7.0], "z": [120.0, 7.0]}


def street(side: str, curved: bool = False, **more: Any) -> Place:
    """A street with a loop at each end; its lane eastwards is at y < 0 with traffic on the right, else at y > 0."""
    sign = 1 if side == "right" else -1
    nodes = {name: [x, sign * y] for name, (x, y) in NODES.items()}
    roads = [{"from": start, "to": end, "curved": curved} for start, end in (("a", "b"), ("c", "d"))]
    roads += [{"from": start, "to": end, "turn": "around"} for start, end in (("b", "c"), ("d", "a"))]
    walks = {"nodes": PAVEMENTS, "ways": [["w", "x"], ["y", "z"]]}
    given = {"nodes": nodes, "roads": roads, "walks": walks, "traffic_side": side} | more
    return place_from({key: value for key, value in given.items() if value is not None}, "own")


def inside(layout: Layout) -> float:
    """Return the sum of the signs of the turns of all bends: loops have two halves that turn round, and two necks."""
    bends = [lane for lane in layout.network.lanes.values() if isinstance(lane, CircularLane)]
    assert len(bends) == 8
    return float(sum(lane.turn * lane.length / lane.radius for lane in bends))


def test_loops_turn_to_the_inner_side() -> None:
    right, left = (inside(street(side).make_layout()) for side in ("right", "left"))
    np.testing.assert_allclose([right, left], [2 * np.pi, -2 * np.pi])


def test_a_loop_to_the_outer_side_is_refused() -> None:
    nodes = {name: [x, -y] for name, (x, y) in NODES.items()}
    with pytest.raises(InvalidValueError, match=r"turns at once by 180 degrees"):
        street("right", nodes=nodes)


@pytest.mark.parametrize("curved", [False, True])
def test_a_line_is_painted_between_the_two_directions(curved: bool) -> None:
    right, left = (np.array(street(side, curved).make_layout().road_map.markings) for side in ("right", "left"))
    assert len(left) == len(right) == 16
    np.testing.assert_allclose(left.mean(axis=1)[:, 1], 0.0, atol=1e-9)
    x, y = left[..., 0], left[..., 1]
    assert ((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) > 0).all()  # counter-clockwise


def test_vehicles_drive_on_the_left_and_turn_round() -> None:
    world = World(make_scenario(street("left"), vehicles=4, pedestrians=0), 1)
    turned = np.zeros(4)
    for _ in range(300):
        before = world.fleet.rows["heading"].copy()
        world.step(0.1)
        turned += (world.fleet.rows["heading"] - before + np.pi) % (2 * np.pi) - np.pi
        rows = world.fleet.rows
        on_street = (rows["x"] > 5) & (rows["x"] < 115)
        assert (np.cos(rows["heading"][on_street]) * rows["y"][on_street] > 0).all()
    assert turned.min() < -3.0 and not world.crashed()


@pytest.mark.parametrize(("side", "sign"), [("right", 1), ("left", -1)])
def test_signs_stand_at_outer_kerbs_and_face_who_comes(side: str, sign: int) -> None:
    entries = furnish(street(side).make_layout(), 3)
    signs = [each for each in entries if each.kind == "sign" and each.at is not None]
    assert len(signs) > 1
    for each in signs:
        assert each.at is not None and each.heading_deg is not None and 4.0 < abs(each.at[1]) < 7.0
        assert sign * np.cos(np.radians(each.heading_deg)) * each.at[1] > 0


@pytest.mark.parametrize("side", ["right", "left"])
def test_crash_barriers_look_to_the_road(side: str) -> None:
    entries = furnish(street(side, walks=None, nodes=LONG[side]).make_layout(), 3)
    barriers = [each.along for each in entries if each.kind == "crash_barrier"]
    assert barriers
    for along in barriers:
        (ax, ay), (bx, _) = along[0], along[-1]
        assert (bx - ax) * -ay > 0, "the road is on the left of the line"


def test_a_street_has_surroundings_at_its_outer_kerbs() -> None:
    for side in ("right", "left"):
        scenario = make_scenario(street(side), vehicles=4, pedestrians=0, detail="street")
        at = np.array([(each.x_m, each.y_m) for each in scenario.layout.bystanders])
        kerb = at[(np.abs(at[:, 1]) < 5.5) & (at[:, 0] > 0) & (at[:, 0] < 120)]
        assert len(kerb) > 1 and (np.abs(kerb[:, 1]) > 4.0).all()


def test_a_word_that_is_no_side_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"traffic_side: unknown traffic_side 'up'.*Accepted: left, right"):
        street("up")
