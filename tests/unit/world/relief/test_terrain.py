"""Ground that rises and falls: near the given heights, smooth, level far away; and a place that lies on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from curved_roads import oval
from lit_crossing import crossing

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import MapArea, MapPatch, MapTree, MapUnit, MapWall, PlaceDescription
from coopsim.world.relief.terrain import STEEPEST, Terrain
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

LOW, HIGH = np.array([-200.0, -160.0]), np.array([200.0, 160.0])


def road(height: object, step_m: float = 8.0) -> Floats:
    """Return places of a street along x and one along y, with heights by x and y."""
    at = np.arange(-100.0, 100.1, step_m)
    places = np.vstack([np.column_stack([at, 0 * at]), np.column_stack([0 * at, at])])
    return np.column_stack([places, height(*places.T)])  # type: ignore[operator]


def test_a_smooth_surface_goes_through_slopes_crests_and_dips() -> None:
    spots = road(lambda x, y: 0.08 * x - 0.03 * y)
    ground = Terrain(spots, LOW, HIGH)
    found = ground.relief.heights(spots[:, :2])
    assert np.ptp(found - spots[:, 2]) < 0.15  # up to a height that all have
    assert ground.steepest == pytest.approx(np.hypot(0.08, 0.03), abs=0.01)
    hill = road(lambda x, y: 6.0 * np.exp(-(x**2 + y**2) / 5000))
    assert np.ptp(Terrain(hill, LOW, HIGH).relief.heights(hill[:, :2]) - hill[:, 2]) < 0.15
    edge = ground.relief.heights(np.array([[150.0, 0.0], [195.0, 0.0], [150.0, 100.0]]))
    assert abs(edge[1] - edge[0]) < 0.08 * 45 / 2  # it levels out
    assert (ground.triangles[..., 2] >= 0.99).all()


def test_steeper_ground_is_smoothed() -> None:
    step = Terrain(road(lambda x, y: np.where(x > 4, 3.0, 0.0)), LOW, HIGH)
    assert 0.03 < step.steepest <= STEEPEST
    assert Terrain(road(lambda x, y: 0.3 * x), LOW, HIGH).steepest > STEEPEST  # no smooth ground is less steep


def hilly(**more: object) -> PlaceDescription:
    """Return a crossing on a slope of 8 % to the east."""
    spots = road(lambda x, y: 0.08 * x)
    return replace(
        crossing(),
        heights=tuple(map(tuple, spots.tolist())),
        walls=(MapWall(((20.0, 12.0), (80.0, 12.0)), 2.0),),
        trees=(MapTree((-30.0, 20.0)),),
        rsus=(MapUnit((30.0, -12.0), (0.0, 0.0)),),
        paved=(
            MapArea(((20, 4.5), (60, 4.5), (60, 8), (20, 8)), "pavement"),
            MapArea(((0, 30), (9, 30), (9, 40)), "grass"),
        ),
        kerb_m=0.12,
        wet=(MapPatch(((30.0, -2.0), (34.0, -2.0), (34.0, 2.0))),),
        **more,
    )


def test_all_of_a_place_lies_and_stands_on_its_ground() -> None:
    layout = place_from(hilly(), "hilly").make_layout()
    relief = layout.relief
    assert relief is not None
    ground = next(part for part in layout.static if part.name == "ground").vertices
    under = min(ground[:, 2])

    def up(name: str) -> Floats:
        """Return how high corners of a kind of part are over the bare ground."""
        points = np.concatenate([part.vertices for part in layout.static if part.name == name])
        points = points[points[:, 2] > 0.5]
        bare = np.interp(points[:, 0], *_profile(ground))
        return points[:, 2] - bare

    assert under > 0.9
    for name, low, high in (("road", -0.1, 0.2), ("pavement", 0.0, 0.3), ("kerb", -0.2, 0.3), ("grass", -0.2, 0.2)):
        assert low < up(name).min() and up(name).max() < high, name
    assert up("wall").min() > -0.2 and up("wall").max() < 2.2
    assert up("building").min() > -5.5 and up("building").min() < -1.0  # 55 m long: its uphill end is in the ground
    assert up("building").max() > 8.5
    (unit,) = layout.rsus
    assert unit.translation[2] == pytest.approx(relief.heights(np.array([[30.0, -12.0]]))[0])
    tops = relief.heights(np.array([[40.0, 6.0], [40.0, 3.0]]))
    assert tops[0] - tops[1] == pytest.approx(0.12, abs=0.03)  # a kerb
    assert (np.abs(up("water")) < 0.2).all()


def _profile(ground: Floats) -> tuple[Floats, Floats]:
    """Return x and z of the ground near the street along x."""
    near = ground[np.abs(ground[:, 1]) < 5.1]
    order = np.argsort(near[:, 0])
    return near[order, 0], near[order, 2]


def test_everybody_stands_on_the_ground() -> None:
    world = World(make_scenario(place_from(hilly(), "hilly"), vehicles=8, connected_cars=2, pedestrians=3), 1)
    for _ in range(20):
        world.step(0.1)
    boxes = world.actors().boxes
    relief = place_from(hilly(), "hilly").make_layout().relief
    feet = boxes.center[:, 2] - boxes.size[:, 2] / 2
    assert np.allclose(feet, relief.heights(boxes.center[:, :2]))
    assert np.ptp(feet) > 2.0
    cars = [body.world_SE3_base.translation for name, body in world.agents().items() if name.startswith("cav")]
    assert np.allclose([at[2] for at in cars], relief.heights(np.array(cars)[:, :2]))


def test_heights_are_checked() -> None:
    with pytest.raises(InvalidValueError, match=r"heights\[1\].*x, y and z, got one of 2"):
        place_from(replace(oval(), heights=((0.0, 0.0, 1.0), (1.0, 2.0))), "wrong")
    with pytest.raises(InvalidValueError, match="at most 150 m from the nodes"):
        place_from(replace(oval(), heights=((0.0, 900.0, 1.0),)), "wrong")
    steep = tuple(map(tuple, road(lambda x, y: 0.3 * x).tolist()))
    with pytest.raises(InvalidValueError, match=r"at most 0.12 m per m.*got 0.\d\d even where it is smooth"):
        place_from(replace(crossing(), heights=steep), "steep")


def test_flat_ground_has_no_relief() -> None:
    assert place_from(crossing(), "flat").make_layout().relief is None
