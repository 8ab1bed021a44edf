"""Streets: who and what stands where, and that nothing stands in anything else."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_places import choose_scenarios
from coopsim.world.furniture.free_ground import GROUND, are_free, lanes_of, lines_of, make_obstacles
from coopsim.world.furniture.furnish import area_of
from coopsim.world.models.built_in import built_in_models
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors
from coopsim.world.surroundings.street import as_street
from coopsim.world.world import BYSTANDER_ID, World

STANDING, SITTING = (frozenset(each.name for each in built_in_models(group)) for group in ("standing", "sitting"))
TOWN = 100_002  # with bays, driveways, and roads of several lanes


@cache
def street() -> Scenario:
    return choose_scenarios("town", detail="street").of(TOWN)


@cache
def full() -> Scenario:
    return choose_scenarios("town", detail="full").of(TOWN)


@cache
def bystanders() -> Actors:
    actors = World(street(), 0).actors()
    return actors[actors.id >= BYSTANDER_ID]


def names() -> np.ndarray:  # type: ignore[type-arg]
    return np.array([each.model for each in street().layout.bystanders])


def corners(boxes: Boxes3D) -> Floats:
    """Return the corners (N, 4, 2) of boxes on the ground."""
    array = boxes.array
    signs = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) / 2
    local = signs * array[:, None, 3:5]
    cos, sin = np.cos(array[:, 6, None]), np.sin(array[:, 6, None])
    x, y = local[..., 0] * cos - local[..., 1] * sin, local[..., 0] * sin + local[..., 1] * cos
    return np.asarray(array[:, None, :2] + np.stack([x, y], axis=-1))


def is_outside(spots: Floats, outlines: list[Floats], margin_m: float) -> np.ndarray:  # type: ignore[type-arg]
    area = np.stack([spots.min(axis=0) - 20, spots.max(axis=0) + 20])
    obstacles = make_obstacles(outlines, [margin_m] * len(outlines), [GROUND] * len(outlines), area)
    return np.asarray(are_free(np.ascontiguousarray(spots), 0.0, GROUND, obstacles))


def test_only_a_street_has_bystanders() -> None:
    assert not full().layout.bystanders and len(street().layout.bystanders) > 100
    assert len(street().static) > len(full().static) + 50
    assert (World(full(), 0).actors().id < BYSTANDER_ID).all()


def test_nobody_overlaps_with_anybody_at_rest() -> None:
    boxes = bystanders().boxes
    overlap = iou_bev(boxes.array, boxes.array) - np.eye(len(boxes))
    assert overlap.max() < 1e-6


def test_nobody_at_rest_is_on_a_lane_in_a_building_or_in_the_way_of_people() -> None:
    layout = street().layout
    spots = corners(bystanders().boxes).reshape(-1, 2)
    assert are_free(spots, 0.0, GROUND, lanes_of(layout, area_of(layout))).all()
    assert is_outside(spots, list(layout.road_map.buildings), 0.0).all()
    assert layout.footways is not None
    assert is_outside(spots, lines_of(layout.footways), 0.6).all()


def test_nobody_who_stands_has_furniture_in_the_body() -> None:
    solid = [part for part in street().static if part.name not in ("ground", "road", "marking") and part.closed]
    points = np.concatenate([part.vertices for part in solid])
    points = points[(points[:, 2] > 0.3) & (points[:, 2] < 1.4)]
    standing = bystanders()[np.isin(names(), list(STANDING))]
    for box in standing.boxes.array:
        near = points[np.abs(points[:, :2] - box[:2]).max(axis=1) < 2.0]
        x, y = _local(near, box)
        assert not ((np.abs(x) < 0.45 * box[3]) & (np.abs(y) < 0.45 * box[4])).any(), box


def _local(points: Floats, box: Floats) -> tuple[Floats, Floats]:
    x, y = (points[:, axis] - box[axis] for axis in range(2))
    cos, sin = np.cos(box[6]), np.sin(box[6])
    return x * cos + y * sin, y * cos - x * sin


def test_many_people_stand_under_leaves_that_hang_low_and_none_hang_over_lanes() -> None:
    layout, before = street().layout, len(full().layout.furnishing)
    crowns = [part.vertices for part in layout.furnishing[before:] if part.name == "tree" and part.opacity < 1]
    leaves = np.concatenate(crowns)
    lanes = lanes_of(layout, area_of(layout))
    assert are_free(np.ascontiguousarray(leaves[leaves[:, 2] < 4.0, :2]), 0.0, GROUND, lanes).mean() > 0.98
    people = bystanders().boxes.array[np.isin(names(), list(STANDING))]
    low = leaves[leaves[:, 2] < 4.0, :2]
    covered = [(np.hypot(*(low - box[:2]).T) < 1.0).any() for box in people]
    assert np.mean(covered) > 0.25


def test_parked_vehicles_face_both_ways() -> None:
    layout = street().layout
    cars = np.isin(bystanders().label, (ObjectClass.CAR, ObjectClass.VAN))
    boxes, backwards = bystanders().boxes[cars], []
    for bay in layout.bays:
        here = np.hypot(boxes.center[:, 0] - bay.x_m, boxes.center[:, 1] - bay.y_m) < 2.0
        backwards += (np.cos(boxes.yaw[here] - bay.heading_rad) < 0).tolist()
    assert len(backwards) > 15 and 0.1 < np.mean(backwards) < 0.6


def test_there_are_all_sorts_of_people_and_things_at_rest() -> None:
    found = bystanders()
    for label in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD, ObjectClass.CAR, ObjectClass.BICYCLE, ObjectClass.SCOOTER):
        assert (found.label == label).any(), label.title
    assert np.isin(names(), list(SITTING)).sum() > 3


def test_bystanders_are_actors_of_their_model_who_never_move() -> None:
    world = World(street(), 0)
    first = world.actors()
    world.step(0.5)
    after = world.actors()
    assert len(np.unique(first.id)) == len(first)
    resting = first.id >= BYSTANDER_ID
    assert [world.models[k].name for k in first.model[resting]] == names().tolist()
    assert (first.label[resting] == [world.models[k].label for k in first.model[resting]]).all()
    assert np.array_equal(first.boxes.array[resting], after.boxes.array[resting])
    assert not after.velocity[resting].any() and after.velocity[~resting].any()
    relief = street().layout.relief
    assert relief is not None
    foot_m = first.boxes.center[resting, 2] - first.boxes.size[resting, 2] / 2
    assert np.allclose(foot_m, relief.heights(first.boxes.center[resting, :2]))


def test_a_seed_gives_the_same_street_and_another_one_another() -> None:
    layout = full().layout
    once = street().layout
    as_street.cache_clear()
    again = choose_scenarios("town", detail="street").of(TOWN).layout
    assert once.bystanders == again.bystanders
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(once.furnishing, again.furnishing, strict=True))
    assert as_street(layout, 1, park=True).bystanders != as_street(layout, 2, park=True).bystanders


def test_bays_stay_free_for_worlds_that_park_themselves() -> None:
    asked = choose_scenarios("town", detail="street", parked=5).of(TOWN)
    actors = World(asked, 0).actors()
    boxes = actors.boxes.array[np.isin(actors.label, (ObjectClass.CAR, ObjectClass.VAN))]
    assert asked.population.parked == 5
    in_bays = [np.hypot(*(boxes[:, :2] - [bay.x_m, bay.y_m]).T).min() < 1.0 for bay in asked.layout.bays]
    assert sum(in_bays) == 5


@pytest.mark.parametrize("place", ["crossing", "highway"])
def test_built_in_places_can_be_streets_too(place: str) -> None:
    scenario = choose_scenarios(place, detail="street").of(0)
    spots = np.array([[each.x_m, each.y_m] for each in scenario.layout.bystanders]).reshape(-1, 2)
    lanes = lanes_of(scenario.layout, area_of(scenario.layout))
    assert are_free(spots, 0.3, GROUND, lanes).all()
    assert len(World(scenario, 0).actors()) > len(spots)
