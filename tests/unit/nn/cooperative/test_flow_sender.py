"""The sender's half of feature flow: which maps are compared, and in which frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from moving_agents import odometry_at, pose_at  # noqa: E402
from street_scene import FRAME_NS, sweep_from  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import CodecError  # noqa: E402
from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.learn.weights import load_cooperative, load_detector  # noqa: E402
from coopsim.nn.cooperative.flow_sender import FlowSender, _before_SE2_now  # noqa: E402
from coopsim.nn.cooperative.perceiver import OwnMap, Perceiver, PlacedMap  # noqa: E402
from coopsim.nn.inference.encoders import PointEncoder  # noqa: E402
from coopsim.types import Odometry, PoseEstimate, SensorView, stack_xyz_yaw  # noqa: E402

CHANNELS = 3


def perceiver() -> Perceiver:
    detector = load_detector(weights_folder() / "pillars.safetensors")
    return Perceiver(load_cooperative(weights_folder() / "ff_tracking.safetensors", detector), 2.4, 7)


def view(frame: int, odometry: Odometry | None = None, heading_error_rad: float = 0.0) -> SensorView:
    """What a moving agent sees of a static world, and where it believes to be."""
    pose = stack_xyz_yaw(pose_at(0, frame))
    believed = np.add(pose, (0.0, 0.0, 0.0, heading_error_rad))
    moved = odometry_at(0, frame) if odometry is None else odometry
    return SensorView("cav_0", frame * FRAME_NS, moved, {"lidar": sweep_from(pose)}, pose=PoseEstimate(believed))


def encoded(seen: SensorView) -> OwnMap:
    encoder = PointEncoder(load_detector(weights_folder() / "pillars.safetensors"))
    assert seen.pose is not None
    return perceiver().encode([encoder.take(seen)])[0]


class Recorder(torch.nn.Module):
    """Keeps what a flow network is given."""

    def __init__(self) -> None:
        super().__init__()
        self.given: list[Any] = []

    def forward(self, now: Any, before: Any, known: Any, interval_s: Any) -> Any:
        self.given.append((now, before, known, float(interval_s)))
        return torch.ones_like(now)


def compared(*views: SensorView) -> tuple[float, float, float]:
    """Return how far a static world's last two maps differ in what the network is given, at most and in the mean, as
    shares of what stands out, and the time between both.
    """
    recorder = Recorder()
    sender = FlowSender(recorder)  # type: ignore[arg-type]
    for each in views:
        sender.add({"cav_0": each}, {"cav_0": encoded(each)})
    now, before, known, interval_s = recorder.given[-1]
    differ = (now - before).abs().amax(1)[known] / (now - now.median()).abs().amax()
    assert known.float().mean() > 0.5
    return float(differ.max()), float(differ.mean()), interval_s


def test_a_static_world_shows_no_motion_to_a_sender_that_moves() -> None:
    worst, mean, interval_s = compared(view(0), view(3, odometry_between(0, 3)))
    assert worst < 0.02 and mean < 0.001
    assert interval_s == pytest.approx(0.3)
    without, _, _ = compared(view(0), view(3, Odometry(np.zeros(4))))
    assert without > 0.1


def odometry_between(first: int, last: int) -> Odometry:
    return Odometry(stack_xyz_yaw(pose_at(0, first).inverse().compose(pose_at(0, last))))


def test_errors_of_the_heading_do_not_turn_the_map_before() -> None:
    """The frames of both maps are turned by them, which odometry knows nothing of, but the sender does."""
    first, second = view(0, heading_error_rad=-0.05), view(1, heading_error_rad=0.1)
    assert first.pose is not None and second.pose is not None
    compass = [
        pose_at(0, frame).compose(SE3.from_xyz_yaw(np.zeros(3), -float(pose.xyz_yaw[3])))
        for frame, pose in enumerate((first.pose, second.pose))
    ]
    true = stack_xyz_yaw(compass[0].inverse().compose(compass[1]))[[0, 1, 3]]
    assert true[2] == pytest.approx(-0.15)
    recorder = FlowSender(Recorder())  # type: ignore[arg-type]
    recorder.add({"cav_0": first}, {"cav_0": encoded(first)})
    before = recorder._before["cav_0"].moved(second.time_ns, second.odometry)
    np.testing.assert_allclose(_before_SE2_now(before, second), true, atol=1e-9)


def test_frames_without_sensor_data_are_followed() -> None:
    recorder = Recorder()
    sender = FlowSender(recorder)  # type: ignore[arg-type]
    sender.add({"cav_0": view(0)}, {"cav_0": encoded(view(0))})
    for frame in (1, 2):
        for _ in range(2):  # what is said twice counts once
            sender.follow("cav_0", frame * FRAME_NS, odometry_at(0, frame))
    sender.follow("cav_9", FRAME_NS, odometry_at(0, 1))
    sender.add({"cav_0": view(3)}, {"cav_0": encoded(view(3))})
    now, before, known, interval_s = recorder.given[-1]
    assert interval_s == pytest.approx(0.3)
    assert float(((now - before).abs().amax(1)[known] / (now - now.median()).abs().amax()).max()) < 0.02


def test_a_message_has_the_map_itself_and_its_change_where_there_was_one_before() -> None:
    sender = FlowSender(Recorder())  # type: ignore[arg-type]
    own = [encoded(view(frame)) for frame in (0, 1)]
    made = [sender.add({"cav_0": view(frame)}, {"cav_0": own[frame]})["cav_0"] for frame in (0, 1)]
    assert made[0] is own[0] and made[0].message.values.shape[0] == CHANNELS
    assert made[1].message.values.shape[0] == 2 * CHANNELS
    np.testing.assert_array_equal(made[1].message.values[:CHANNELS], own[1].message.values)
    assert (made[1].message.values[CHANNELS:] == 1).all() and made[1].message.space == own[1].message.space


@pytest.mark.parametrize("second_ns", [0, -1, 6 * FRAME_NS])
def test_a_map_of_another_episode_or_long_before_says_nothing(second_ns: int) -> None:
    sender, own = FlowSender(Recorder()), encoded(view(0))  # type: ignore[arg-type]
    for time_ns in (0, second_ns):
        seen = replace(view(0), time_ns=time_ns)
        assert sender.add({"cav_0": seen}, {"cav_0": own})["cav_0"] is own


def test_a_receiver_takes_a_late_map_as_it_is_now() -> None:
    """As if its sender had sent the moved map; without delay, as if it had sent no change."""
    network, own = perceiver(), encoded(view(0))
    change = np.random.default_rng(0).normal(size=own.message.values.shape).astype(np.float32)
    both = network.receive(replace(own.message, values=np.concatenate([own.message.values, change])))
    grid = own.message.grid

    def fused(message: Any, delay_s: float) -> Any:
        return network.fuse(own, grid, [PlacedMap(message, np.array([1.2, 0.3, 0.1]), delay_s, 0)])

    still = network.receive(own.message)
    assert torch.equal(fused(both, 0.0), fused(still, 0.0))
    moved = replace(own.message, values=own.message.values + np.float32(0.3) * change)
    late = fused(both, 0.3)
    torch.testing.assert_close(late, fused(network.receive(moved), 0.3))
    assert not torch.equal(late, fused(still, 0.3))
    with pytest.raises(CodecError, match="must have 3 or 6 channels, got 4"):
        network.receive(replace(own.message, values=np.zeros((4, *grid.shape), np.float32)))
