"""Places with a relief: what one sees of the ground is what all stand on."""

from typing import Any

import numpy as np
import pytest
import yaml

from coopsim.envs.simulated.scenario_file import SHIPPED
from coopsim.errors import InvalidValueError
from coopsim.sensors.scene import RayScene, static_triangles
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.place import place_from
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

VILLAGE = yaml.safe_load((SHIPPED / "village.yaml").read_text())["place"]
GROUND = {
    "kerb_m": 0.12,
    "crown": 0.025,
    "humps": [{"at": [45, 0], "heading_deg": 0, "width_m": 8, "height_m": 0.1}],
    "wet": [{"outline": [[-40, -3.5], [-25, 0.5], [-33, 1.5], [-41, 0]]}],
}


def layout_of(**ground: Any) -> Layout:
    return place_from({**VILLAGE, **ground}, "village").make_layout()


@pytest.fixture(scope="module")
def layout() -> Layout:
    return layout_of(**GROUND)


def test_heights_are_where_rays_meet_the_ground(layout: Layout) -> None:
    assert layout.relief is not None
    flat = ("ground", "road", "pavement", "kerb", "hump", "marking", "water")
    scene = RayScene(static_triangles([part for part in layout.static if part.name in flat]))
    rng, lanes = np.random.default_rng(0), list(layout.network.lanes.values())
    along, aside = rng.uniform(size=1500), rng.uniform(-0.5, 0.5, 1500)
    on = [lanes[k % len(lanes)] for k in range(1500)]
    roads = [lane.position(s * lane.length, t * lane.width) for lane, s, t in zip(on, along, aside, strict=True)]
    places = np.concatenate([np.array(roads), rng.uniform([-60, -20], [60, 60], (1500, 2))])
    above = np.column_stack([places, np.full(len(places), 3.0)])
    seen = [3.0 - scene.cast(eye, np.array([[0.0, 0.0, -1.0]])).range_m[0] for eye in above]
    heights = layout.relief.heights(places)
    assert np.abs(np.array(seen) - heights).max() < 0.0121
    assert (heights > 0.05).sum() > 400
    assert heights.max() > 0.1


def test_lanes_side_by_side_meet_at_one_height(layout: Layout) -> None:
    assert layout.relief is not None
    for lane in layout.network.lanes.values():
        along = np.linspace(0.0, lane.length, 200)
        for aside in (-1.99, 0.0, 1.99):
            line = np.array([lane.position(s, aside) for s in along])
            steps = np.abs(np.diff(layout.relief.heights(line))) / np.maximum(lane.length / 199, 1e-9)
            assert steps.max() < 0.15, "a hump of 3.7 m is the steepest"
            across = layout.relief.heights(np.array([lane.position(lane.length / 2, a) for a in (1.999, 2.001)]))
            assert abs(np.diff(across)[0]) < 1e-3


def test_all_stand_on_the_ground(layout: Layout) -> None:
    assert layout.relief is not None
    place = place_from({**VILLAGE, **GROUND}, "village")
    world = World(make_scenario(place, pedestrians=14, parked=4, drones=1), 3)
    rises = []
    for _ in range(60):
        world.step(0.1)
        actors = world.actors()
        ground = layout.relief.heights(actors.boxes.center[:, :2])
        np.testing.assert_allclose(actors.boxes.center[:, 2] - actors.boxes.size[:, 2] / 2, ground, atol=1e-12)
        rises.append(ground[actors.label == ObjectClass.PEDESTRIAN].max())
        for body in world.agents().values():
            at = body.world_SE3_base.translation
            assert at[2] == pytest.approx(layout.relief.heights(at[None, :2])[0], abs=1e-12)
    assert max(rises) == pytest.approx(0.12)
    assert max(body.world_SE3_base.translation[2] for body in world.agents().values()) > 0.02
    for mast, unit in zip((part for part in layout.static if part.name == "mast"), layout.rsus, strict=False):
        assert mast.vertices[:, 2].min() == pytest.approx(unit.translation[2])


def test_flat_ground_changes_nothing() -> None:
    plain, zero = layout_of(), layout_of(kerb_m=0, crown=0, humps=[], wet=[])
    assert plain.relief is zero.relief is None
    for one, other in zip(plain.static, zero.static, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_the_ground_is_few_triangles(layout: Layout) -> None:
    plain = sum(len(part.faces) for part in layout_of().static)
    assert sum(len(part.faces) for part in layout.static) < 1.4 * plain  # measured: 1.28


def test_water_is_darker_than_the_road(layout: Layout) -> None:
    parts = {part.name: part for part in layout.static}
    assert parts["water"].reflectivity < 0.7 * parts["road"].reflectivity
    assert sum(parts["water"].color) < sum(parts["road"].color)


@pytest.mark.parametrize(
    ("ground", "said"),
    [
        ({"kerb_m": 1}, "kerb_m"),
        ({"crown": -0.1}, "crown"),
        ({"humps": [{"at": [45, 30], "heading_deg": 0, "width_m": 8}]}, "a hump must be on a road"),
        ({"humps": [{"at": [45, 0], "heading_deg": 0, "width_m": 8, "height_m": 0.5}]}, "height_m"),
        ({"wet": [{"outline": [[0, 0], [4, 0], [1, 1], [0, 4]]}]}, "convex"),
    ],
)
def test_mistakes_are_named(ground: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        layout_of(**ground)
