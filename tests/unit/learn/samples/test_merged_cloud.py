"""What a teacher sees: everyone's points, where the receiver's targets are."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_samples import CooperativeSample, scene_samples

sys.path.append(str(Path(__file__).parent))
from test_cloud_samples import clip

torch.set_num_threads(1)


def samples(taught: bool, **settings: float) -> list[CooperativeSample]:
    drawn = scene_samples(clip(3), np.random.default_rng(0), SampleSettings(**settings), taught=taught)  # type: ignore[arg-type]
    assert drawn and all(sample.views for sample in drawn)
    return drawn


@pytest.mark.parametrize("mirrored", [0.0, 1.0])
def test_every_object_of_the_targets_has_points(mirrored: float) -> None:
    """Also with errors of poses and late messages: the teacher has neither."""
    found = samples(True, mirrored=mirrored, noise_m=3.0, noise_deg=10.0, late=1.0, dropout=0.0)
    for view in (view for sample in found for view in sample.views):
        assert view.merged is not None and view.merged.clouds == 1
        rows, columns = view.merged.shape
        assert (rows, columns) == (2 * view.grid.shape[0], 2 * view.grid.shape[1])
        hit = torch.zeros(rows * columns, dtype=torch.bool)
        hit[view.merged.cell] = True
        near = torch.nn.functional.max_pool2d(hit.view(1, rows, columns).float(), 2)[0]
        near = torch.nn.functional.max_pool2d(near[None], 3, 1, 1)[0]
        now = view.targets.heat[0, 0] == 1
        assert now.any()
        assert near[now].mean() > 0.9  # of objects in late messages only, some have no points now


def test_samples_are_otherwise_those_without_a_teacher() -> None:
    for one, other in zip(samples(True, noise_m=1.0), samples(False, noise_m=1.0), strict=True):
        assert torch.equal(one.pillars.features, other.pillars.features)
        for a, b in zip(one.views, other.views, strict=True):
            assert torch.equal(a.targets.heat, b.targets.heat) and b.merged is None
            np.testing.assert_array_equal(a.source_SE2_target, b.source_SE2_target)
