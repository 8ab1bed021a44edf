"""Clips of recordings: what is in them, and that the same number gives the same clip."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import tiny_recordings as tiny

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.recorded import MixedClips, RecordedClips
from coopsim.learn.clips.sources import clips_of_recipe
from coopsim.learn.clips.store import load_clip, save_clip
from coopsim.learn.recipe import TrainingRecipe


@pytest.fixture
def clips(tmp_path: Path) -> RecordedClips:
    return RecordedClips((str(tiny.write_opv2v(tmp_path / "set")),), frames=3, dt_s=(0.1,), seed=4)


def test_a_clip_shows_the_scene(clips: RecordedClips) -> None:
    clip = clips.clip(0)
    assert len(clip.scenes) == tiny.FRAMES and clip.dt_s == pytest.approx(tiny.STEP_S)
    for number, scene in enumerate(clip.scenes):
        assert scene.time_ns == pytest.approx(number * 1e8) and scene.object_id.tolist() == list(tiny.IDS)
        np.testing.assert_allclose(scene.boxes, tiny.boxes(number).array, atol=1e-4)
        np.testing.assert_allclose(scene.velocity, [[tiny.SPEED_M_S, 0.0], [0.0, 0.0]], atol=1e-3)
        assert scene.returns.shape == (2, 2) and (scene.returns >= 4).all()
        for agent, world_SE3_base in zip(scene.agents, tiny.WORLD_SE3_BASES, strict=True):
            points, _ = tiny.cloud(number, world_SE3_base)
            np.testing.assert_allclose(agent.points[:, :3], points, atol=0.006)
            np.testing.assert_allclose(agent.xyz_yaw[:3], world_SE3_base.translation, atol=1e-4)


def test_a_number_gives_the_same_clip_in_any_process(clips: RecordedClips, tmp_path: Path) -> None:
    again = pickle.loads(pickle.dumps(clips)).clip(2)
    assert again.key == clips.clip(2).key
    save_clip(tmp_path / "clip.npz", again)
    stored = load_clip(tmp_path / "clip.npz")
    for one, other in zip(stored.scenes, clips.clip(2).scenes, strict=True):
        assert (one.agents[0].points == other.agents[0].points).all()
        assert (one.agents[1].odometry == other.agents[1].odometry).all()


@pytest.mark.parametrize(
    ("frames", "dt_s", "shown", "expected_s"), [(2, 0.2, 2, 0.2), (2, 9.0, 2, 0.2), (9, 0.1, 3, 0.1)]
)
def test_a_clip_fits_into_its_sequence(
    frames: int, dt_s: float, shown: int, expected_s: float, clips: RecordedClips
) -> None:
    clip = RecordedClips(clips.folders, frames, (dt_s,)).clip(0)
    assert len(clip.scenes) == shown and clip.dt_s == pytest.approx(expected_s)


def test_a_recipe_names_a_folder_where_an_environment_stands(clips: RecordedClips) -> None:
    world = {"environments": list(clips.folders), "frames": 2, "dt_s": [0.1]}
    assert clips_of_recipe(TrainingRecipe("x", world=world), 7) == RecordedClips(clips.folders, 2, (0.1,), 7)
    mixed = clips_of_recipe(TrainingRecipe("x", world={**world, "environments": ["town", *clips.folders]}), 7)
    assert isinstance(mixed, MixedClips) and mixed.share == 0.5
    with pytest.raises(InvalidValueError, match="cameras must be left out where environments has recordings"):
        clips_of_recipe(TrainingRecipe("x", world={**world, "cameras": {"front": 1}}), 7)


def test_two_sources_are_mixed(clips: RecordedClips) -> None:
    other = RecordedClips(clips.folders, 1, (0.1,), 9)
    mixed = MixedClips(clips, other, 0.5, seed=0)
    lengths = [len(mixed.clip(k).scenes) for k in range(12)]
    assert set(lengths) == {1, 3}
    assert lengths == [len(mixed.clip(k).scenes) for k in range(12)]
