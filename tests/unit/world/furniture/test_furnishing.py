"""Meshes of furniture: at their place on their ground, sensed by the ray grid as by embree."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.cast.ray_grid import RayGrid
from coopsim.sensors.lidar.expected_returns import LineOfSight
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import static_triangles
from coopsim.world.furniture.furnishing import FurnitureEntry, furnishing_parts, line_pieces
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors


def test_pieces_stand_at_their_place_and_heading() -> None:
    (wood, _) = furnishing_parts([{"kind": "bench", "at": [10.0, 5.0], "heading_deg": 90.0}])
    low, high = wood.vertices.min(axis=0), wood.vertices.max(axis=0)
    assert (low + high)[:2] / 2 == pytest.approx([10.0, 5.0], abs=0.05)
    assert high[0] - low[0] == pytest.approx(1.8, abs=1e-6), "it looks along y, so it is long along x"
    back = wood.vertices[wood.vertices[:, 2] > 0.6]
    assert back[:, 1].max() < 5.0, "its back is behind"
    (cabinet,) = furnishing_parts([{"kind": "cabinet", "at": [10.0, 5.0], "heading_deg": 90.0}])
    assert cabinet.boxes is not None and cabinet.boxes[0, 6] == pytest.approx(np.pi / 2)
    assert cabinet.boxes[0, :2] == pytest.approx([10.0, 5.0])


def test_lines_are_cut_into_pieces_of_one_length() -> None:
    middles, headings, lengths = line_pieces(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 3.0]]), 4.0)
    assert lengths == pytest.approx([10 / 3] * 3 + [3.0]) and headings == pytest.approx([0, 0, 0, np.pi / 2])
    assert middles[0] == pytest.approx([10 / 6, 0.0]) and middles[-1] == pytest.approx([10.0, 1.5])
    fence = furnishing_parts([{"kind": "fence", "along": [[0, 0], [10, 0]], "height_m": 1.5}])
    points = np.concatenate([part.vertices for part in fence])
    assert points[:, 0].min() == pytest.approx(0.0, abs=0.1) and points[:, 0].max() == pytest.approx(10.0, abs=0.1)
    assert points[:, 2].max() == pytest.approx(1.5, abs=0.06)


def test_the_ground_lifts_pieces() -> None:
    entries = [{"kind": "bin", "at": [x, 0.0], "heading_deg": 0.0} for x in (0.0, 10.0)]
    (low,), (high,) = (
        [part for part in furnishing_parts(entries, lambda points: 0.012 * points[:, 0]) if where(part.vertices[0, 0])]
        for where in (lambda x: x < 5, lambda x: x > 5)
    )
    assert low.vertices[:, 2].min() == pytest.approx(0.0) and high.vertices[:, 2].min() == pytest.approx(0.12)
    assert low.boxes is not None and high.boxes is not None
    assert high.boxes[:, 2] - low.boxes[:, 2] == pytest.approx(0.12)


def test_no_furniture_is_no_mesh() -> None:
    assert furnishing_parts([]) == ()


@pytest.mark.parametrize("name", ["crossing", "parking_street"])
def test_the_ray_grid_senses_furniture_as_embree_does(name: str) -> None:
    triangles = static_triangles(make_scenario(name, detail="full").static)
    pattern = PATTERNS.get("VLP-16")
    pose = SE3(Rotation.from_euler("xyz", [0.01, -0.02, 0.3]).as_matrix(), np.array([-30.3, -1.7, 1.9]))
    hits = RayGrid(pattern.elevation_rad, pattern.offset_rad, 720).cast(triangles, pose)
    expected = RayScene(triangles).cast(pose.translation, pose.rotate(pattern.directions(720)))
    ours, theirs = hits.range_m.ravel(), expected.range_m
    same = np.isclose(ours, theirs, atol=1e-3) | (np.isinf(ours) & np.isinf(theirs))
    # A ray that passes within rounding of an edge may take either side of it: there are many edges among leaves.
    assert same.mean() > 0.9995
    assert (expected.face >= 0).mean() > 0.3


def test_furniture_hides_where_no_rays_are_cast() -> None:
    boxes = Boxes3D(np.array([[20.0, 0.0, 0.8]]), np.array([[4.0, 1.8, 1.6]]), np.array([np.pi / 2]))
    one = np.ones(1, np.int64)
    car = Actors(one, boxes, np.zeros((1, 2)), 0 * one, 0 * one, np.zeros((1, 3), dtype=np.uint8))

    def returns(*entries: FurnitureEntry) -> int:
        sight = LineOfSight(furnishing_parts(entries), PATTERNS.get("HDL-64E"), 1800, 100.0)
        return int(sight.expected_returns(np.array([0.0, 0.0, 1.5]), car, None)[0])

    free = returns()
    assert free > 200
    assert returns({"kind": "lamp", "at": [10.0, 0.0], "heading_deg": 0.0}) == free, "too thin to count"
    hedge = {"kind": "hedge", "along": [[10.0, -9.0], [10.0, 9.0]], "height_m": 2.5}
    assert 0.02 * free < returns(hedge) < 0.5 * free, "some rays pass between leaves"
    trailer = [{"kind": "trailer", "at": [10.0, y], "heading_deg": 90.0} for y in (-3.0, 0.0, 3.0)]
    assert returns(*trailer) < 0.5 * free
