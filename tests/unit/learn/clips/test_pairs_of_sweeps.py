"""Clips with a second frame shortly after each, for networks on two sweeps."""

from __future__ import annotations

import warnings

import pytest

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sample_frames import joined, sweeps_of
from coopsim.learn.train import make_task

PLACE = {"junctions": 1, "cars": (1, 1), "density": (0.5, 0.5), "lidars": {"HDL-32E": 1.0}, "start_s": (0.0, 1.0)}


def test_every_second_frame_has_a_sweep_before_that_is_joined() -> None:
    clip = SimulatedClips(WorldRecipe(frames=2, dt_s=(1.0,), sweep_s=(0.2,), **PLACE)).clip(0)  # type: ignore[arg-type]
    assert [scene.time_ns for scene in clip.scenes] == [0, 200_000_000, 1_000_000_000, 1_200_000_000]
    assert [joined(clip, k) for k in range(4)] == [False, True, False, True]
    ages_s = [sorted(set(sweeps_of(clip, k, 0, 2)[:, 4].tolist())) for k in (2, 3)]
    assert ages_s[0] == [0.0] and ages_s[1] == pytest.approx([0.0, 0.2])


def test_sweeps_that_come_after_the_next_frame_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="half of every dt_s"):
        WorldRecipe(dt_s=(0.3,), sweep_s=(0.2,))


def test_a_training_on_two_sweeps_says_that_its_world_has_one() -> None:
    small = {"sweeps": 2, "pillar_features": 8, "channels": [8, 8, 8], "layers": [0, 0, 0], "features": 8}
    with pytest.warns(UserWarning, match=r"world\.sweep_s"):
        make_task(TrainingRecipe("two", network=small), 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_task(TrainingRecipe("two", network=small, world={"sweep_s": [0.1]}), 0)
