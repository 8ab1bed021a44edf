"""Samples of feature flow: late maps fit those before and after, as odometry tells."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from moving_agents import clip_of_moving_agents  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.learn.samples.cloud_samples import SampleSettings  # noqa: E402
from coopsim.learn.samples.flow_samples import FlowDraft, FlowSample  # noqa: E402
from coopsim.learn.samples.fused_samples import scene_samples  # noqa: E402
from coopsim.learn.weights import load_detector  # noqa: E402
from coopsim.nn.cooperative.warp import warp  # noqa: E402
from coopsim.nn.detector.encoder import EncoderConfig  # noqa: E402
from coopsim.types import stack_xyz_yaw  # noqa: E402

torch.set_num_threads(1)
CLIP, COARSE = clip_of_moving_agents(5), EncoderConfig(2.4)


def samples(seed: int = 0, **changed: object) -> list[FlowSample]:
    given = {"dropout": 0.0, "late": 1.0, "thinned": 0.0, "mirrored": 0.0, "reach_m": 76.8, **changed}
    drawn = scene_samples(CLIP, np.random.default_rng(seed), SampleSettings(**given), COARSE, draft=FlowDraft)  # type: ignore[arg-type]
    assert len(drawn) == 5 and all(sample.scene.views for sample in drawn)
    return drawn


@pytest.mark.parametrize("mirrored", [0.0, 1.0])
def test_a_static_world_has_not_moved_in_a_moving_senders_maps(mirrored: float) -> None:
    encoder, elsewhere = load_detector(weights_folder() / "pillars.safetensors").encoder, []
    for sample in samples(mirrored=mirrored)[2:]:
        late, grid = sample.late, sample.scene.grid
        with torch.no_grad():
            features = encoder(sample.scene.pillars)
        for rows, way in ((late.before, late.before_SE2_late), (late.later, late.later_SE2_late)):
            found, valid = warp(features[rows], grid, grid, way)
            differ = (found - features[late.late]).abs().amax(1)[valid] / features.std()
            assert valid.float().mean() > 0.5 and float(differ.max()) < 0.02
            elsewhere.append(float((features[rows] - features[late.late]).abs().max() / features.std()))
    assert np.mean(elsewhere) > 1.0


def test_late_maps_have_one_before_and_one_of_now() -> None:
    for number, sample in enumerate(samples()):
        late = sample.late
        assert len(late.late) == (0 if number < 2 else 2)
        sent = {row for view in sample.scene.views for row in view.others}
        assert set(late.late) <= sent
        assert {view.own for view in sample.scene.views} == set(late.later) or not late.late
        assert late.interval_s == [0.1] * len(late.late)
        assert all(0.09 < delay_s <= 0.1 * (number - 1) + 1e-6 for delay_s in late.delay_s)
        by_row = dict(zip(late.late, late.delay_s, strict=True))
        for view in sample.scene.views:
            stated = dict(zip(view.others, view.delay_s.tolist(), strict=True))
            assert {row: stated[row] for row in view.others if row in by_row} == pytest.approx(
                {row: by_row[row] for row in view.others if row in by_row}
            )


@pytest.mark.parametrize("mirrored", [False, True])
def test_errors_of_poses_do_not_come_between_a_senders_own_maps(mirrored: bool) -> None:
    """They turn and shift the frames of maps, which the sender knows."""
    settings = SampleSettings(noise_m=3.0, noise_deg=9.0, reach_m=57.6, mirrored=float(mirrored))
    draft = FlowDraft(CLIP, 4, [0, 1], np.random.default_rng(4), settings, COARSE)
    frames = [SE3.from_xyz_yaw(each[:3], each[3]) for each in (draft.frames[draft.row(k, 1)] for k in (1, 4))]
    true = stack_xyz_yaw(frames[0].inverse().compose(frames[1]))[[0, 1, 3]]
    assert abs(true[2]) > 0.01
    told = draft._planar(draft._way(1, 4, 1))
    np.testing.assert_allclose(told, true * ([1, -1, -1] if mirrored else [1, 1, 1]), atol=1e-9)


def test_points_are_left_out_of_all_maps_of_a_sender_alike() -> None:
    whole, thinned = samples(), samples(thinned=1.0)
    for one, other in zip(whole[2:], thinned[2:], strict=True):
        shares = []
        for sample in (one, other):
            counts = torch.zeros(sample.scene.pillars.clouds).index_add_(
                0,
                torch.div(sample.scene.pillars.cell, sample.scene.pillars.shape[0] ** 2, rounding_mode="floor"),
                sample.scene.pillars.count.float(),
            )
            shares.append([counts[rows] for rows in (sample.late.late, sample.late.before, sample.late.later)])
        left = [b / a for a, b in zip(*shares, strict=True)]
        assert float((left[0] - left[1]).abs().max()) < 0.1 and float((left[0] - left[2]).abs().max()) < 0.1
        assert float(left[0].min()) < 0.95
