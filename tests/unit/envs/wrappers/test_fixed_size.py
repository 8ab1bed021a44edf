"""Rows of fixed number: which boxes are in them, where, and with what."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from codec_samples import some_points, some_tracks
from learner_scenes import boxes, found, message, scene

from coopsim.envs.wrappers.fixed_size import DETECTION_COLUMNS, MESSAGE_COLUMNS, OWN_COLUMNS, FixedSizeView
from coopsim.errors import CoopsimError
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, Message
from coopsim.types.taxonomy import ObjectClass


def assert_in_spaces(view: FixedSizeView, shown: dict[str, Any]) -> None:
    spaces = view.spaces()
    assert spaces.keys() == shown.keys()
    for name, space in spaces.items():
        assert space.contains(shown[name]), name
        assert shown[name].dtype == np.float32


@pytest.mark.parametrize(("order", "ahead"), [("nearest", [5, 10, 20]), ("surest", [30, 20, 10])])
def test_the_nearest_or_surest_stay_where_not_all_fit(order: str, ahead: list[float]) -> None:
    detections = found(*[(x, 0, 0, 0) for x in (20, 5, 30, 10)], score=[0.8, 0.1, 0.9, 0.3])
    view = FixedSizeView(detections=3, order=order)
    shown = view.show(scene(detections))
    assert shown["detections"][:, 0].tolist() == ahead
    assert shown["detections_mask"].tolist() == [1, 1, 1]


def test_columns_are_as_documented() -> None:
    shown = FixedSizeView(detections=2).show(scene(found((3, -4, 1, 2.0), score=[0.7], label=ObjectClass.BUS)))
    row = dict(zip(DETECTION_COLUMNS, shown["detections"][0].tolist(), strict=True))
    wanted = {"x": 3, "y": -4, "z": 1, "l": 4, "w": 2, "h": 1.5, "cos_yaw": np.cos(2), "sin_yaw": np.sin(2)}
    wanted |= {"score": 0.7, "bus": 1}
    assert row == pytest.approx(dict.fromkeys(DETECTION_COLUMNS, 0) | wanted)


def test_padding_is_zero_and_masked() -> None:
    view = FixedSizeView(detections=4, messages=2, received=3, points=5)
    shown = view.show(scene(found((3, 0, 0, 0)), points=[[1, 2, 3]]))
    assert_in_spaces(view, shown)
    assert shown["detections_mask"].tolist() == [1, 0, 0, 0]
    assert shown["points_mask"].tolist() == [1, 0, 0, 0, 0]
    assert shown["points"][0].tolist() == [1, 2, 3, 0.5]
    assert not shown["received_mask"].any() and not shown["messages_mask"].any()
    assert not shown["detections"][1:].any() and not shown["received"].any() and not shown["points"][1:].any()


def test_received_boxes_are_moved_by_the_estimated_poses() -> None:
    """The world's boxes, seen by a sender at capture, are where the receiver's estimate puts them now."""
    world = boxes((60, 40, 1, 0.3), (70, 45, 1, -2.0))
    then, now = (50.0, 30.0, 0.5, 1.1), (45.0, 42.0, 0.0, -0.4)
    world_SE3_sender, world_SE3_base = (SE3.from_xyz_yaw(pose[:3], pose[3]) for pose in (then, now))
    seen = world.transform(world_SE3_sender.inverse())
    sent = message("cav_1", then, Detections(seen, np.array([0.9, 0.8]), np.zeros(2, int)))
    shown = FixedSizeView(order="surest").show(scene(inbox=[sent], pose=now, time_ns=300_000_000))
    wanted = world.transform(world_SE3_base.inverse())
    received = shown["received"][0, :2]
    np.testing.assert_allclose(received[:, :6], wanted.array[:, :6], atol=1e-4)
    np.testing.assert_allclose(np.arctan2(received[:, 7], received[:, 6]), wanted.yaw, atol=1e-5)
    row = dict(zip(MESSAGE_COLUMNS, shown["messages"][0].tolist(), strict=True))
    assert row["age"] == pytest.approx(0.3)
    place = world_SE3_base.inverse().apply(np.array(then[:3]))
    assert [row["x"], row["y"], row["z"]] == pytest.approx(place.tolist(), abs=1e-4)
    assert np.arctan2(row["sin_heading"], row["cos_heading"]) == pytest.approx(1.5)


def test_the_newest_messages_come_first_and_then_those_of_the_nearest_senders() -> None:
    sent = [
        message("cav_1", (10, 0, 0, 0), found((5, 5, 0, 0)), captured_ns=0),
        message("cav_2", (30, 0, 0, 0), found((5, 5, 0, 0)), captured_ns=10**8),
        message("cav_1", (20, 0, 0, 0), found((5, 5, 0, 0), (8, 5, 0, 0)), captured_ns=10**8),
    ]
    shown = FixedSizeView(messages=2).show(scene(inbox=sent, time_ns=10**8))
    assert shown["messages"][:, 0].tolist() == [20, 30]
    assert shown["received_mask"].sum(axis=1).tolist() == [2, 1]
    np.testing.assert_allclose(shown["received"][0, :2, 0], [25, 28], atol=1e-4)


def test_each_message_keeps_its_nearest_boxes() -> None:
    places = [(x, 0, 0, 0) for x in (40, 10, 30, 20)]
    sent = [message(name, (x, 3, 0, 0), found(*places)) for name, x in (("cav_1", 1), ("cav_2", 2))]
    shown = FixedSizeView(received=3).show(scene(inbox=sent))
    np.testing.assert_allclose(shown["received"][:2, :, 0], [[11, 21, 31], [12, 22, 32]], atol=1e-4)


def test_tracks_have_velocities_in_the_receivers_axes() -> None:
    tracks = some_tracks(3)
    sent = message("cav_1", (10, 0, 0, np.pi / 2), tracks, codec="tracks")
    shown = FixedSizeView(order="surest").show(scene(inbox=[sent]))
    order = np.argsort(-tracks.tracks.score, kind="stable")
    vx, vy = tracks.tracks.velocity[order].T
    np.testing.assert_allclose(shown["received"][0, :3, -2:], np.column_stack([-vy, vx]), atol=0.02)


def test_the_receiver_itself_is_left_out() -> None:
    sent = message("cav_1", (20, 0, 0, np.pi), found((20.5, 0.3, 0, 0), (10, 0, 0, 0)))
    shown = FixedSizeView().show(scene(inbox=[sent]))
    np.testing.assert_allclose(shown["received"][0, shown["received_mask"][0] == 1, 0], [10], atol=1e-4)


@pytest.mark.parametrize(
    "sent",
    [
        Message("cav_1", 0, scene().observation.pose, b"broken", "detections"),
        message("cav_1", (5, 0, 0, 0), some_points(5), codec="points"),
    ],
    ids=["broken", "points"],
)
def test_a_message_without_boxes_has_a_row_and_no_boxes(sent: Message) -> None:
    shown = FixedSizeView().show(scene(inbox=[sent]))
    assert shown["messages_mask"].sum() == 1 and not shown["received_mask"].any()


def test_what_is_no_number_too_far_or_too_large_stays_in_the_space() -> None:
    rows = np.array([[5, 0, 0, 4, 2, 1, 0], [np.nan, 0, 0, 4, 2, 1, 0], [1e300, 0, 0, 4, 2, 1, 0]])
    rows = np.concatenate([rows, [[6, 0, 0, 1e300, 2, 1, 1e5], [7, 0, 0, -1, 2, 1, 0]]])
    strange = Detections(boxes().from_array(rows), np.array([1e300, 1, 1, -1e300, 1]), np.zeros(5, int))
    view = FixedSizeView(points=3)
    shown = view.show(scene(strange, pose=(1e300, 0, 0, 1), points=[[1e30, 0, 0], [1, 1, 1]]))
    assert_in_spaces(view, shown)
    assert shown["detections_mask"].sum() == 2 and shown["points_mask"].sum() == 1


def test_points_are_spread_over_all() -> None:
    shown = FixedSizeView(points=5).show(scene(points=np.column_stack([np.arange(100), np.zeros((100, 2))])))
    assert shown["points"][:, 0].tolist() == [0, 20, 40, 60, 80]


def test_points_beyond_reach_take_no_rows() -> None:
    """Half of the points are too far, in one sweep with those that stay."""
    shown = FixedSizeView(points=50, reach_m=49.5).show(
        scene(points=np.column_stack([np.arange(100), np.zeros((100, 2))]))
    )
    assert shown["points_mask"].all()
    assert shown["points"][:, 0].tolist() == list(range(50))


def test_own_tells_the_estimated_pose_and_motion() -> None:
    shown = FixedSizeView().show(scene(pose=(3, 4, 1, 0.5)))
    row = dict(zip(OWN_COLUMNS, shown["own"].tolist(), strict=True))
    wanted = {"x": 3, "y": 4, "z": 1, "cos_heading": np.cos(0.5), "sin_heading": np.sin(0.5), "sensed": 1}
    assert row == pytest.approx(dict.fromkeys(OWN_COLUMNS, 0) | wanted)


def test_zero_leaves_keys_out() -> None:
    view = FixedSizeView(detections=0, messages=0)
    assert set(view.show(scene(found((3, 0, 0, 0)), points=[[1, 2, 3]]))) == {"own"} == set(view.spaces())
    view = FixedSizeView(detections=0, received=0)
    assert set(view.show(scene())) == {"own", "messages", "messages_mask"} == set(view.spaces())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"detections": -1}, "detections must be an integer >= 0, got -1"),
        ({"messages": 2.0}, "messages must be an integer >= 0, got 2.0"),
        ({"order": "newest"}, "unknown order 'newest'.*Accepted: nearest, surest"),
        ({"reach_m": 0}, "reach_m must be a finite number > 0, got 0"),
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(CoopsimError, match=says):
        FixedSizeView(**wrong)
