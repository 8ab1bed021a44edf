"""Senders placed by what they and the receiver see: over time, with honest and dishonest covariances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coopsim.fusion.alignment import ErrorProcess, PoseAlignment
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.localization.odometry import OdometryFrame
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate

FRAME_NS = 100_000_000
STANDING = (0.0, 0.0, 0.0), (25.0, 6.0, 2.0)
NAMES = {"cav_0": True, "cav_1": True}


def seen_from(pose: SE3, rng: np.random.Generator, count: int, away_m: float) -> Detections:
    """Objects on a grid, some decimetres off, as an agent at that pose detects them."""
    grid = np.stack(np.meshgrid(np.arange(5) * 12.0, np.arange(4) * 9.0), axis=-1).reshape(-1, 2)[:count] + away_m
    rows = np.column_stack([grid, np.tile([0.8, 4.5, 1.9, 1.6, 0.0], (len(grid), 1))])
    boxes = Boxes3D.from_array(rows).transform(pose.inverse())
    noisy = boxes.center + rng.normal(0, 0.08, boxes.center.shape) * [1, 1, 0]
    return Detections(Boxes3D(noisy, boxes.size, boxes.yaw), np.full(count, 0.9), np.zeros(count, dtype=int))


def errors_m(
    error: Any,
    *,
    frames: int = 40,
    count: int = 12,
    covariance: Any = None,
    apart_m: float = 0.0,
    seen: bool = True,
    least: int = 2,
) -> np.ndarray:
    """(frames, 2) how far from the truth the sender is placed, without and with alignment.

    Args:
        error: frame -> error (3,) of the sender's stated pose, x, y m and heading rad.
        frames: how many.
        count: number of objects.
        covariance: what both state.
        apart_m: how far the sender's objects are from the receiver's; 0: they are the same.
        seen: whether the agents may be seen by each other.
        least: of the alignment.
    """
    alignment = PoseAlignment(dict.fromkeys(NAMES, seen), "cav_0", least)
    there = SE3.from_xyz_yaw([*STANDING[1][:2], 0.0], STANDING[1][2])
    played = play(alignment, error, frames=frames, count=count, covariance=covariance, apart_m=apart_m)
    return np.array([[np.hypot(*(pose.translation - there.translation)[:2]) for pose in each] for each in played])


def play(
    alignment: PoseAlignment, error: Any, *, frames: int, count: int = 12, covariance: Any = None, apart_m: float = 0.0
) -> list[tuple[SE3, SE3]]:
    """The sender's pose in each frame as it is stated and as it is placed; arguments as of `errors_m`."""
    rng, frame = np.random.default_rng(0), OdometryFrame()
    here, there = (SE3.from_xyz_yaw([x, y, 0.0], yaw) for x, y, yaw in STANDING)
    poses = []
    for k in range(frames):
        x, y, yaw = np.asarray(STANDING[1]) + error(k)
        said = PoseEstimate(np.array([x, y, 0.0, yaw]), covariance)
        message = Message("cav_1", k * FRAME_NS, said, b"", "detections")
        own, stated = seen_from(here, rng, count, 5.0), PoseEstimate(np.zeros(4), covariance)
        observation = Observation(k * FRAME_NS, stated, Odometry(np.zeros(4)), own)
        frame.move(observation)
        heard = (message, seen_from(there, rng, count, 5.0 + apart_m))
        placed = alignment.place(observation, frame, own, [heard])[0]
        poses.append((said.world_SE3_base, placed))
    return poses


def white(size: float, heading_rad: float) -> Any:
    draws = np.random.default_rng(3).standard_normal((200, 3)) * [size, size, heading_rad]
    return lambda k: draws[k]


def constant(*error: float) -> Any:
    return lambda k: np.array(error)


@pytest.mark.parametrize("error", [white(0.5, 0.009), white(1.0, 0.017), constant(0.8, -0.6, 0.01)])
def test_what_is_left_of_an_error_is_a_few_centimetres(error: Any) -> None:
    before, after = errors_m(error)[5:].T
    assert before.mean() > 0.5 and after.mean() < 0.12


def test_without_an_error_hardly_anything_is_changed() -> None:
    after = errors_m(constant(0, 0, 0))[:, 1]
    assert after.mean() < 0.06 and after.max() < 0.2


def test_nothing_is_corrected_where_nothing_is_shared() -> None:
    before, after = errors_m(white(0.5, 0.009), apart_m=300.0, seen=False).T
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_fewer_common_objects_than_asked_for_correct_nothing() -> None:
    before, after = errors_m(white(0.5, 0.009), count=3, least=9).T
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_a_constant_error_stays_corrected_while_nothing_is_shared() -> None:
    """What was learned of a bias outlives the objects that it was learned from."""
    rng, frame, alignment = np.random.default_rng(0), OdometryFrame(), PoseAlignment(NAMES, "cav_0")
    here, there = (SE3.from_xyz_yaw([x, y, 0.0], yaw) for x, y, yaw in STANDING)
    said = PoseEstimate(np.array([STANDING[1][0] + 0.6, STANDING[1][1], 0.0, STANDING[1][2]]))
    for k in range(60):
        own = seen_from(here, rng, 12, 5.0) if k < 55 else Detections.empty()
        observation = Observation(k * FRAME_NS, PoseEstimate(np.zeros(4)), Odometry(np.zeros(4)), own)
        frame.move(observation)
        heard = (Message("cav_1", k * FRAME_NS, said, b"", "detections"), seen_from(there, rng, 12, 5.0))
        placed = alignment.place(observation, frame, own, [heard])[0]
    assert np.hypot(*(placed.translation - there.translation)[:2]) < 0.25


@pytest.mark.parametrize(("apart_m", "least_m", "most_m"), [(0.0, 0.01, 0.15), (300.0, 0.6, 0.8)])
def test_what_may_be_left_of_an_error_is_known(apart_m: float, least_m: float, most_m: float) -> None:
    """Common objects leave little of what both state; without any, the sum of both is left."""
    alignment = PoseAlignment(dict.fromkeys(NAMES, False), "cav_0")
    assert alignment.covariance("cav_1") is None
    stated = np.diag(np.square([0.5, 0.5, 0.009]))
    play(alignment, white(0.5, 0.009), frames=10, covariance=stated, apart_m=apart_m)
    left = alignment.covariance("cav_1")
    assert left is not None and left.shape == (3, 3)
    assert np.all((np.sqrt(np.diagonal(left))[:2] > least_m) & (np.sqrt(np.diagonal(left))[:2] < most_m))


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_an_overconfident_covariance_is_found_out(scale: float) -> None:
    """A tenth of the true deviation is stated: the filter learns the true one from what the objects say."""
    stated = np.diag(np.square([0.5, 0.5, 0.009])) * scale
    before, after = errors_m(white(0.5, 0.009), covariance=stated, frames=60)[30:].T
    assert after.mean() < 0.25 * before.mean()


def test_the_same_message_twice_is_placed_twice_alike_and_an_unknown_sender_is_placed() -> None:
    rng, frame = np.random.default_rng(0), OdometryFrame()
    alignment = PoseAlignment(NAMES, "cav_0")
    here, there = (SE3.from_xyz_yaw([x, y, 0.0], yaw) for x, y, yaw in STANDING)
    own = seen_from(here, rng, 8, 5.0)
    said = PoseEstimate(np.array([25.5, 6.0, 0.0, 2.0]))
    heard = [(Message(name, 0, said, b"", ""), seen_from(there, rng, 8, 5.0)) for name in ("cav_1", "stranger")]
    observation = Observation(0, PoseEstimate(np.zeros(4)), Odometry(np.zeros(4)), own)
    frame.move(observation)
    first, other, again = alignment.place(observation, frame, own, [*heard, heard[0]])
    np.testing.assert_array_equal(first.translation, again.translation)
    assert np.hypot(*(other.translation - there.translation)[:2]) < 0.2


def test_senders_that_change_their_names_for_ever_are_forgotten() -> None:
    frame, alignment = OdometryFrame(), PoseAlignment(NAMES, "cav_0")
    for k in range(0, 900, 3):
        own, here = Detections.empty(), PoseEstimate(np.zeros(4))
        observation = Observation(k * FRAME_NS, here, Odometry(np.zeros(4)), own)
        frame.move(observation)
        alignment.place(observation, frame, own, [(Message(f"cav_{k}", k * FRAME_NS, here, b"", ""), own)])
    assert len(alignment._senders) == len(alignment._used_ns) <= 201


@pytest.mark.parametrize(("kept", "size"), [(0.0, 0.5), (0.95, 0.3), (1.0, 0.8)])
def test_how_large_an_error_is_and_how_long_it_lasts_is_learned(kept: float, size: float) -> None:
    rng, moments = np.random.default_rng(4), ErrorProcess(np.square([0.1, 0.1, 0.002]))
    value, noise = rng.normal(size=3) * size, np.full(3, 0.02**2)
    for _ in range(300):
        value = kept * value + np.sqrt(1 - kept**2) * rng.normal(size=3) * size
        moments.forget()
        moments.learn(value + rng.normal(size=3) * 0.02, noise)
    assert 0.3 < np.sqrt(moments.variance[0]) / size < 2
    assert abs(moments.correlation[0] - kept) < 0.35
