"""The picture: what is ahead is above, what is left is left, and nothing is lost for being small."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from codec_samples import some_tracks
from learner_scenes import found, message, scene

from coopsim.envs.wrappers.bev_image import PLANES, BevImageView
from coopsim.errors import CoopsimError
from coopsim.types import PointCloud
from coopsim.world.snapshot import RoadMap

EMPTY = RoadMap((), (), (), ())
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def painted(view: BevImageView, of: Any, road_map: RoadMap = EMPTY) -> dict[str, Any]:
    """Planes by name."""
    view.begin(road_map)
    (picture,) = view.show(of).values()
    (space,) = view.spaces().values()
    assert space.contains(picture)
    return dict(zip(view.planes, picture, strict=True))


def lit(plane: Any) -> set[tuple[int, int]]:
    return {(int(row), int(column)) for row, column in np.argwhere(plane)}


def small(**options: Any) -> BevImageView:
    """One metre a pixel; the agent is between rows 9 and 10, and columns 9 and 10."""
    return BevImageView(**({"size": 20, "metres": 20.0, "channels": ("detections",)} | options))


def test_ahead_is_up_and_left_is_left() -> None:
    planes = painted(small(), scene(found((6.0, 3.0, 0, 0), score=[0.6])))
    wanted = {(row, column) for row in (2, 3, 4, 5) for column in (6, 7)}  # 4 m long, 2 m wide
    assert lit(planes["detections.occupied"]) == wanted
    assert planes["detections.score"].max() == round(0.6 * 255)
    assert planes["detections.cos"][3, 6] == 255 and planes["detections.sin"][3, 6] == round(255 / 2)


def test_a_box_is_turned_by_its_heading() -> None:
    planes = painted(small(), scene(found((6.0, 3.0, 0, np.pi / 2))))
    assert lit(planes["detections.occupied"]) == {(row, column) for row in (3, 4) for column in (5, 6, 7, 8)}
    assert planes["detections.sin"][3, 6] == 255


def test_the_area_of_a_turned_box_is_right() -> None:
    view = BevImageView(size=400, metres=20.0, channels=("detections",))
    for yaw in np.linspace(-3, 3, 7):
        plane = painted(view, scene(found((2.0, -1.0, 0, yaw))))["detections.occupied"]
        assert (plane > 0).sum() * 0.05**2 == pytest.approx(8.0, rel=0.02)


def test_a_small_box_has_a_pixel() -> None:
    detections = found((3.1, 2.1, 0, 0.3))
    tiny = type(detections)(type(detections.boxes)(detections.boxes.center, np.full((1, 3), 0.1), detections.boxes.yaw),
                            detections.score, detections.label)  # fmt: skip
    assert lit(painted(small(), scene(tiny))["detections.occupied"]) == {(6, 7)}


def test_the_surest_is_on_top_and_what_is_outside_is_cut() -> None:
    detections = found((5, 0, 0, 0), (5, 0, 0, 0), (10, 10, 0, 0.5), (500, 0, 0, 0), score=[0.9, 0.2, 0.5, 1.0])
    planes = painted(small(), scene(detections))
    assert planes["detections.score"][5, 9] == round(0.9 * 255)
    assert planes["detections.occupied"][0, 0] == 255


def test_points_show_their_number_and_height() -> None:
    many = [[5.5, -2.5, 0.0]] * 64 + [[5.5, -2.5, 2.0], [-9.5, 9.5, -1.0], [50, 0, 0], [1.5, 1.5, 99.0]]
    planes = painted(small(channels=("points",)), scene(points=many))
    assert lit(planes["points.density"]) == {(4, 12), (19, 0), (8, 8)}
    assert planes["points.density"][4, 12] == 255 and planes["points.density"][19, 0] == int(255 / np.log2(65))
    assert planes["points.height"][4, 12] == 255 // 2 and planes["points.height"][8, 8] == 255


def test_boxes_of_messages_are_placed_and_fade() -> None:
    sent = message("cav_1", (8.0, 0, 0, np.pi / 2), found((0.0, 4.0, 0, 0)))  # left of it: nearer to the receiver
    planes = painted(small(channels=("messages",)), scene(inbox=[sent], time_ns=10**9))
    assert lit(planes["messages.occupied"]) == {(row, column) for row in (5, 6) for column in (8, 9, 10, 11)}
    assert planes["messages.fresh"].max() == 128


def test_points_of_messages_are_shown() -> None:
    cloud = PointCloud(np.array([[1.5, 0.5, 0.0]], np.float32), np.zeros(1, np.float32))
    sent = message("cav_1", (3.0, 0, 0, 0), cloud, codec="points")
    planes = painted(small(channels=("messages",)), scene(inbox=[sent]))
    assert lit(planes["messages.occupied"]) == {(5, 9)} == lit(planes["messages.fresh"])
    assert not planes["messages.score"].any()


def test_velocities_of_tracks() -> None:
    sent = message("cav_1", (0, 0, 0, 0), some_tracks(4), codec="tracks")
    planes = painted(BevImageView(metres=400.0, channels=("velocity",)), scene(inbox=[sent]))
    assert set(planes) == {"velocity.vx", "velocity.vy"}
    assert planes["velocity.vx"].any() and planes["velocity.vy"].any()


@pytest.mark.parametrize(("yaw", "wanted"), [(0.0, (5, 7)), (np.pi / 2, (7, 14)), (np.pi, (14, 12))])
def test_the_map_is_turned_and_moved(yaw: float, wanted: tuple[int, int]) -> None:
    """A square metre from 4 m to 5 m ahead (x) and 2 m to 3 m left (y) of where the agent thinks that it is."""
    lane = SQUARE * 0.9 + 0.05 + [104.0, 202.0]
    view = small(channels=("map",))
    planes = painted(view, scene(pose=(100, 200, 0, yaw)), RoadMap((lane,), (), (), (SQUARE + 1000,)))
    assert lit(planes["map.lanes"]) == {wanted}
    assert not planes["map.buildings"].any()


def test_every_layer_of_the_map_has_its_plane() -> None:
    layers = [(SQUARE + np.array([2.0 * k, 0.0]),) for k in range(5)]
    planes = painted(small(channels=("map",)), scene(), RoadMap(*layers))
    for k, name in enumerate(("lanes", "crosswalks", "pavements", "buildings", "markings")):
        assert planes[f"map.{name}"][9 - 2 * k, 9], name


def test_float32_is_the_same_picture_from_0_to_1() -> None:
    of = scene(found((5, 0, 0, 0.3)), points=[[1, 2, 3]])
    whole, real = (painted(BevImageView(dtype=dtype), of) for dtype in ("uint8", "float32"))
    assert any(plane.any() for plane in whole.values())
    for name, plane in whole.items():
        np.testing.assert_allclose(real[name], plane / 255, atol=1e-6)
        assert real[name].dtype == np.float32


def test_nothing_is_black() -> None:
    planes = painted(BevImageView(channels=tuple(PLANES)), scene())
    assert len(planes) == sum(map(len, PLANES.values()))
    assert not any(plane.any() for plane in planes.values())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"size": 4}, "size must be an integer in 8..4096, got 4"),
        ({"metres": -1}, "metres must be a finite number > 0, got -1"),
        ({"channels": "map"}, "channels must be a sequence of detections, points"),
        ({"channels": ()}, "channels must be a sequence of detections, points"),
        ({"channels": ("maps",)}, "unknown channel 'maps'"),
        ({"channels": ("map", "map")}, "channels must be distinct"),
        ({"dtype": "float64"}, "unknown dtype 'float64'. Did you mean"),
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(CoopsimError, match=says):
        BevImageView(**wrong)
