"""Samples of stage B: maps, messages and truth fit together."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_samples import VIEW_CELLS, VIEW_REACH_M, SceneDraft, scene_samples
from coopsim.nn.cooperative.warp import warp
from coopsim.types import BevGrid

sys.path.append(str(Path(__file__).parent))
from test_cloud_samples import clip

torch.set_num_threads(1)
PLAIN = {"dropout": 0.0, "thinned": 0.0, "late": 0.0}


def hit(sample, view) -> float:
    """Return the share of the true centres at which some map, moved as the receiver believes, is warm."""
    rows = [view.own, *view.others]
    offsets = np.concatenate([np.zeros((1, 3)), view.source_SE2_target])
    moved, _ = warp(sample.seen[rows], sample.grid, view.grid, offsets)
    centre = view.targets.heat[0, 0] == 1
    return float((moved[:, 0].amax(0)[centre] > 0.1).float().mean())


@pytest.mark.parametrize("mirrored", [0.0, 1.0])
def test_every_true_object_is_where_a_map_shows_it(mirrored: float) -> None:
    samples = scene_samples(clip(3), np.random.default_rng(0), SampleSettings(mirrored=mirrored, **PLAIN))
    assert len(samples) == len(clip(3).scenes)
    for sample in samples:
        assert len(sample.views) == 3
        assert all(hit(sample, view) == 1 for view in sample.views)


def test_with_errors_of_poses_some_are_not() -> None:
    settings = SampleSettings(noise_m=3.0, **PLAIN)
    shares = [hit(s, v) for s in scene_samples(clip(4), np.random.default_rng(0), settings) for v in s.views]
    assert np.mean(shares) < 0.97


@pytest.mark.parametrize("mirrored", [0.0, 1.0])
def test_maps_lie_on_cells_of_the_world_whatever_the_errors_of_poses(mirrored: float) -> None:
    settings = SampleSettings(noise_m=1.0, noise_deg=2.0, mirrored=mirrored, dropout=0.0)
    samples = scene_samples(clip(3), np.random.default_rng(0), settings)
    assert len(samples) == len(clip(3).scenes)
    for sample in samples:
        cells = np.concatenate([view.source_SE2_target[:, :2] for view in sample.views]) / (4 * sample.grid.cell_m)
        assert np.abs(cells).max() > 1
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-6)


def test_parts_reach_the_edge_of_the_surroundings_and_end_there() -> None:
    cell_m = VIEW_REACH_M / (VIEW_CELLS // 2 + 1)  # a part may begin at three places along an axis
    draft = SimpleNamespace(grid=BevGrid((-cell_m, cell_m), (-cell_m, cell_m), cell_m), rng=np.random.default_rng(0))
    parts = [SceneDraft._part(draft, np.zeros((0, 7))) for _ in range(60)]
    low, high = -VIEW_REACH_M, VIEW_REACH_M - VIEW_CELLS * cell_m
    for axis in ("x_m", "y_m"):
        begins = {round(getattr(part, axis)[0] / cell_m) for part in parts}
        assert begins == {round(low / cell_m), round((low + high) / 2 / cell_m), round(high / cell_m)}


def test_a_share_of_samples_has_no_errors() -> None:
    settings = SampleSettings(noise_m=3.0, noisy=0.5, **PLAIN)
    samples = [each for seed in range(3) for each in scene_samples(clip(4), np.random.default_rng(seed), settings)]
    shares = [min(hit(sample, view) for view in sample.views) for sample in samples]
    assert 0.2 < np.mean(np.array(shares) == 1) < 0.9


def test_truth_is_what_the_receiver_or_a_sender_has_seen() -> None:
    samples = scene_samples(clip(3), np.random.default_rng(0), SampleSettings(**PLAIN))
    for sample, scene in zip(samples, clip(3).scenes, strict=True):
        seen = (scene.returns > 0).any(axis=1).sum()
        assert all(view.targets.objects <= seen for view in sample.views)
        assert max(view.targets.objects for view in sample.views) > (scene.returns > 0).sum(axis=0).max()


def test_late_messages_are_of_earlier_scenes_and_say_how_late() -> None:
    settings = SampleSettings(late=1.0, dropout=0.0)
    first, *others = scene_samples(clip(3, dt_s=0.2), np.random.default_rng(0), settings)
    assert not first.views[0].delay_s.any()
    for sample in others:
        assert all(0.19 < delay < 0.41 for view in sample.views for delay in view.delay_s.tolist())
        assert sample.pillars.clouds == 6  # each agent's map of now, and of then


def test_views_know_the_kinds_of_all() -> None:
    made = clip(2)
    kinds = ("cav", "rsu", "drone")
    scenes = tuple(
        replace(each, agents=tuple(replace(agent, kind=kind) for agent, kind in zip(each.agents, kinds, strict=True)))
        for each in made.scenes
    )
    samples = scene_samples(replace(made, scenes=scenes), np.random.default_rng(0), SampleSettings(**PLAIN))
    assert len(samples) == len(scenes)
    for sample in samples:
        assert [view.own_kind for view in sample.views] == [0, 1, 2]
        assert [view.kind.tolist() for view in sample.views] == [[1, 2], [0, 2], [0, 1]]


def test_a_lone_agent_has_no_sample() -> None:
    assert scene_samples(clip(2, agents=1), np.random.default_rng(0), SampleSettings()) == []


def test_some_messages_are_sparse() -> None:
    samples = scene_samples(clip(4), np.random.default_rng(0), SampleSettings(sparse=0.5, dropout=0.0))
    most = {view.most_cells is None for sample in samples for view in sample.views}
    assert most == {True, False}


def test_as_many_receivers_are_taught_as_asked_for_and_all_others_send() -> None:
    made = clip(4, agents=4)
    samples = scene_samples(made, np.random.default_rng(0), SampleSettings(receivers=2, dropout=0.0))
    assert {len(sample.views) for sample in samples} == {2}
    assert {len(view.others) for sample in samples for view in sample.views} == {3}
    everyone = scene_samples(made, np.random.default_rng(0), SampleSettings(dropout=0.0))
    assert {len(sample.views) for sample in everyone} == {4}


def test_every_agent_may_be_the_receiver_that_is_taught() -> None:
    made, kinds = clip(4), ("cav", "rsu", "drone")
    scenes = tuple(
        replace(each, agents=tuple(replace(agent, kind=kind) for agent, kind in zip(each.agents, kinds, strict=True)))
        for each in made.scenes
    )
    settings, rng = SampleSettings(**PLAIN, receivers=1), np.random.default_rng(0)
    samples = [sample for _ in range(5) for sample in scene_samples(replace(made, scenes=scenes), rng, settings)]
    assert {view.own_kind for sample in samples for view in sample.views} == {0, 1, 2}


def test_clean_samples_have_no_errors_nothing_late_and_all_cells() -> None:
    settings = SampleSettings(noise_m=3.0, noise_deg=3.0, late=1.0, sparse=1.0, dropout=0.0, thinned=0.0, clean=1.0)
    for sample in scene_samples(clip(3, dt_s=0.2), np.random.default_rng(0), settings):
        for view in sample.views:
            assert hit(sample, view) == 1 and view.error == (0.0, 0.0)
            assert not view.delay_s.any() and view.most_cells is None


def test_views_state_the_errors_that_poses_were_drawn_with() -> None:
    settings = SampleSettings(noise_m=1.0, noise_deg=2.0, noisy=1.0, dropout=0.0)
    told = [view.error for each in scene_samples(clip(4), np.random.default_rng(0), settings) for view in each.views]
    assert all(0 < metres < 2**0.5 and np.isclose(turn, metres * np.deg2rad(2.0)) for metres, turn in told)


def with_points(count: int):
    """Return a sample of two agents that keep this many points each."""
    made = clip(1, agents=2)
    agents = tuple(replace(agent, points=agent.points[:count]) for agent in made.scenes[0].agents)
    scenes = (replace(made.scenes[0], agents=agents),)
    return scene_samples(replace(made, scenes=scenes), np.random.default_rng(0), SampleSettings(**PLAIN))[0]


def test_objects_without_points_left_are_not_taught_and_those_with_few_count_neither_way() -> None:
    few, enough = with_points(1), with_points(12)  # an object has 12 points for each agent that sees it
    assert few.objects == 0 and few.doubtful.any() and all(view.targets.objects == 0 for view in few.views)
    assert enough.objects == 2 and not enough.doubtful.any()
    assert all(0 < view.targets.objects <= 2 for view in enough.views)
