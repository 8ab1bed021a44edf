"""Situations with vehicles lead to a crash if the ego does not react, and hide the other vehicle until late."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.world.places.crossings import make_parking_street
from coopsim.world.situations.overtaking import Detour
from coopsim.world.situations.sites import first_share
from coopsim.world.situations.situation import SITUATIONS
from coopsim.world.world import World

DT_S = 0.1
NAMES = ("left_turn_across", "queue_end", "overtaking", "merge_barrier")
SEEDS = range(12)


def played(
    name: str, seed: int, see: Callable[[Any], object] = len, **options: Any
) -> tuple[list[str], Any, list[Any]]:
    """Let the ego keep its speed until it crashes; return the names of roles, the last rows, and what was seen."""
    scenario = SITUATIONS.get(name)(**options).of(seed)
    assert scenario.script is not None
    world, seen = World(scenario, seed, control="acceleration", driven=["cav_0"]), []
    for _ in range(round(scenario.script.over_s / DT_S)):
        seen.append(see(world.fleet.rows))
        world.step(DT_S, {"cav_0": 0.0})
        if world.fleet.rows["crashed"][0]:
            break
    return [role.name for role in (scenario.script.ego, *scenario.script.vehicles)], world.fleet.rows, seen


def outline(row: Any) -> Floats:
    """Return the corners (4, 2) of a vehicle."""
    along = np.array([np.cos(row["heading"]), np.sin(row["heading"])]) * row["length"] / 2
    left = np.array([-np.sin(row["heading"]), np.cos(row["heading"])]) * row["width"] / 2
    return np.array([row["x"], row["y"]]) + np.array([along + left, left - along, -along - left, along - left])


def hides(rows: Any, hider: int, other: int) -> bool:
    """Return whether a vehicle stands between the middles of the ego and of another one."""
    ends = [np.array([rows[k]["x"], rows[k]["y"]]) for k in (0, other)]
    return first_share(ends[0], ends[1], outline(rows[hider])) is not None


@pytest.mark.parametrize("name", NAMES)
def test_without_a_reaction_the_ego_crashes_with_the_vehicle_that_conflicts(name: str) -> None:
    scenario = SITUATIONS.get(name)().of(0)
    assert scenario.script is not None
    (other,) = [k for k, role in enumerate(scenario.script.vehicles, start=1) if role.conflicts]
    crashed = [played(name, seed)[1]["crashed"] for seed in SEEDS]
    assert np.mean([each[0] and each[other] for each in crashed]) > 0.75


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_gives_the_same_bits_and_another_seed_another_situation(name: str) -> None:
    first, again, other = (played(name, seed)[1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first["x"], other["x"])


@pytest.mark.parametrize("name", NAMES)
def test_penetration_connects_the_same_vehicles_and_moves_none(name: str) -> None:
    none, all_of_them = (SITUATIONS.get(name)(penetration=share).of(7) for share in (0.0, 1.0))
    worlds = [World(each, 7, control="planner", driven=["cav_0"]) for each in (none, all_of_them)]
    np.testing.assert_array_equal(worlds[0].fleet.rows, worlds[1].fleet.rows)
    agents = [tuple(World(SITUATIONS.get(name)(penetration=0.5).of(seed), seed).agents()) for seed in SEEDS]
    assert len(set(agents)) == 1 and len(worlds[1].agents()) > len(agents[0]) > len(worlds[0].agents())


def test_the_end_of_the_queue_is_hidden_until_the_vehicle_ahead_leaves_its_lane() -> None:
    for seed in SEEDS:
        roles, _, seen = played("queue_end", seed, np.copy)
        end, leader = roles.index("end of the queue"), roles.index("leader")
        stays = np.array([rows["target_lane"][leader] == rows["target_lane"][0] for rows in seen])
        hidden = np.array([hides(rows, leader, end) for rows in seen])
        assert 10 < stays.sum() < len(stays) - 8 and hidden[stays].all() and not hidden[-1]


@pytest.mark.parametrize(("name", "before_s"), [("left_turn_across", 2.5), ("overtaking", 3.2)])
def test_a_truck_hides_the_oncoming_car(name: str, before_s: float) -> None:
    hidden = []
    for seed in SEEDS:
        roles, _, seen = played(name, seed, np.copy)
        rows = seen[max(0, len(seen) - round(before_s / DT_S))]
        hidden.append(hides(rows, roles.index("truck"), roles.index("oncoming")))
    assert np.mean(hidden) > 0.75


def test_the_detour_leads_aside_and_back_without_a_kink() -> None:
    layout, index = make_parking_street(), ("exit0", "bend0", 0)
    lane, detour = layout.network.get_lane(index), Detour(15.0, 4.0, 12.0)
    network, roads = detour.add_to(layout.network, index, 10.0)
    pieces = [network.get_lane((*road, 0)) for road in roads]
    for before, after in pairwise(pieces):
        np.testing.assert_allclose(before.position(before.length, 0.0), after.position(0.0, 0.0), atol=1e-9)
        turned = before.heading_at(before.length) - after.heading_at(0.0)
        assert abs((turned + np.pi) % (2 * np.pi) - np.pi) < 1e-9
    aside = [lane.local_coordinates(pieces[3].position(along, 0.0))[1] for along in (0.0, pieces[3].length)]
    np.testing.assert_allclose(aside, 4.0)
    assert sum(piece.length for piece in pieces) > lane.length
    assert index not in network.lanes and ("pull_out", "pull_in", 0) in network.lanes


@pytest.mark.parametrize("name", ["left_turn_across", "queue_end", "merge_barrier"])
def test_situations_with_a_place_of_their_own_refuse_others(name: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match="place"):
        SITUATIONS.get(name)(place="town")
