"""Rows that attackers make up look like the honest ones among which they stand, and poses drift as far as allowed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from coopsim.attacks.claims import Claims
from coopsim.attacks.envelopes import PoseDrift, PoseOffset
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Message, PoseEstimate

CAR = [0.0, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0]
RNG = np.random.default_rng


def claims(count: int = 2) -> Claims:
    boxes = Boxes3D.from_array(np.tile(CAR, (count, 1)))
    return Claims(np.arange(count), boxes, np.full((count, 2), 7.0), np.ones(count), np.zeros(count, np.int64))


@pytest.mark.parametrize("with_velocity", [True, False])
def test_made_up_detections_state_a_velocity_where_honest_ones_do(with_velocity: bool) -> None:
    honest = Detections(
        Boxes3D.from_array(np.tile(CAR, (3, 1))), np.full(3, 0.5), np.zeros(3, np.int64),
        velocity=np.zeros((3, 2)) if with_velocity else None,
    )  # fmt: skip
    rows = claims().among_detections(honest, RNG(0))
    assert len(rows) == 5
    assert (rows.velocity is not None) == with_velocity
    if rows.velocity is not None:
        assert sorted(rows.velocity[:, 0].tolist()) == [0.0, 0.0, 0.0, 7.0, 7.0]


def message(covariance: Any = None) -> Message:
    return Message("rsu_0", 0, PoseEstimate(np.array([10.0, 20.0, 0.0, 0.5]), covariance), b"boxes", "detections")


def view(time_s: float) -> Any:
    return SimpleNamespace(rng=RNG(1), time_s=time_s)


def test_the_usual_offset_is_along_the_world_s_x_alone() -> None:
    np.testing.assert_allclose(PoseOffset().send(view(0.0), message()).pose.xyz_yaw, [13.0, 20.0, 0.0, 0.5])


@pytest.mark.parametrize("knows", ["nothing", "agreement"])
def test_a_pose_drifts_up_to_its_limit_and_less_where_agreement_is_tested(knows: str) -> None:
    far = {}
    for most_m in (0.1, 5.0):
        attack = PoseDrift(speed_m_s=1.0, most_m=most_m, direction_rad=0.0, knows=knows, start_s=0.0)
        far[most_m] = [float(attack.send(view(t), message()).pose.xyz_yaw[0]) - 10.0 for t in (0.05, 2.0, 100.0)]
    assert far[0.1] == pytest.approx([0.05, 0.1, 0.1])
    assert far[5.0][0] == pytest.approx(0.05)
    if knows == "nothing":
        assert far[5.0][1:] == pytest.approx([2.0, 5.0])
    else:
        assert far[5.0][1] == far[5.0][2] < 2.0
