"""Boxes whose motions a sample shows: inexact, half of them backwards, and only where two sweeps are compared."""

from __future__ import annotations

import numpy as np
import torch
from synthetic_clips import SyntheticClips

from coopsim.learn.samples.cloud_samples import SampleSettings, collate_detector, detector_samples
from coopsim.learn.samples.moved_boxes import moved_boxes
from coopsim.nn.detector.encoder import EncoderConfig

SETTINGS = SampleSettings(reach_m=19.2, crop_cells=None, merged=0.0, thinned=0.0, single=0.0)
STREET = EncoderConfig(sweeps=2, head="street")


def test_motions_are_those_of_inexact_boxes_half_of_them_backwards() -> None:
    count, rng = 400, np.random.default_rng(0)
    yaw = rng.uniform(-3.0, 3.0, count)
    boxes = np.column_stack([np.zeros((count, 2)), np.ones(count), np.tile([4.5, 1.9, 1.6], (count, 1)), yaw])
    velocity = 8.0 * np.column_stack([np.cos(yaw), np.sin(yaw)])
    points = np.array([[0, 0, 1.16, 0.5, 0.0], [-0.8, 0, 1.16, 0.5, 0.1]], np.float32)
    made, again = (moved_boxes(points, boxes, velocity, np.random.default_rng(3)) for _ in range(2))
    along, left = made.motion.T
    torch.testing.assert_close(made.motion.norm(dim=1), torch.full((count,), 8.0))
    assert 0.4 < (along < 0).float().mean() < 0.6
    assert 0.1 < left.std() < 1.0 and along.abs().min() > 7.0
    assert made.sweeps.counts.sum(dim=(2, 3)).amax(0).tolist() == [0, 1, 0, 0, 1, 0]
    torch.testing.assert_close(made.motion, again.motion, rtol=0, atol=0)
    torch.testing.assert_close(made.sweeps.counts, again.sweeps.counts, rtol=0, atol=0)


def test_samples_of_two_sweeps_show_motions_to_a_network_that_compares_them() -> None:
    clip = SyntheticClips().clip(0)
    samples = detector_samples(clip, np.random.default_rng(0), SETTINGS, STREET)
    single = [not (sample.pillars.features[:, 8] > 0).any() for sample in samples]
    assert any(single) and not all(single)
    for sample, one in zip(samples, single, strict=True):
        assert sample.moved is not None
        assert (len(sample.moved.motion) == 0) == one
    batch = collate_detector(samples)
    assert batch.moved is not None and len(batch.moved.motion) == len(batch.moved.sweeps.counts) > 4
    np.testing.assert_allclose(batch.moved.motion.norm(dim=1), 5.0, rtol=1e-5)


def test_samples_for_other_networks_are_the_same_as_without() -> None:
    clip = SyntheticClips().clip(0)
    plain = detector_samples(clip, np.random.default_rng(0), SETTINGS, EncoderConfig(sweeps=2))
    assert all(sample.moved is None for sample in plain) and collate_detector(plain).moved is None
    (first, *_) = detector_samples(clip, np.random.default_rng(0), SETTINGS, STREET)
    np.testing.assert_array_equal(first.pillars.features, plain[0].pillars.features)
