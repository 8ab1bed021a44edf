"""Clips of a training: made ahead, and none of the test places."""

from pathlib import Path

import pytest
from synthetic_clips import SyntheticClips

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.ahead import ClipsAhead
from coopsim.learn.clips.sources import LaterClips, clips_of_recipe, held_out_clips
from coopsim.learn.recipe import TrainingRecipe


def test_clips_made_ahead_are_the_same_from_anywhere() -> None:
    clips = SyntheticClips(frames=1)
    with ClipsAhead(clips, 1, 2) as ahead:
        assert [ahead.clip(k).key for k in (4, 5, 9, 10)] == [clips.clip(k).key for k in (4, 5, 9, 10)]


def test_places_of_training_and_of_looks_differ_and_the_test_places_are_in_neither(tmp_path: Path) -> None:
    recipe = TrainingRecipe("x", world={"rain_share": 0.0})
    training, looks = clips_of_recipe(recipe, 3), held_out_clips(recipe)
    assert "first_place=100000" in repr(training) and "first_place=1000," in repr(looks)
    assert LaterClips(SyntheticClips()).clip(0).key == "synthetic 1000000000"
    assert "cameras={}" in repr(looks)
    for kind in ("pictures", "points_and_pictures"):
        assert "cameras={'surround': 1.0}" in repr(held_out_clips(TrainingRecipe("x", kind)))
    assert "dt_s=(0.5,)" in repr(looks)
    for kind in ("cooperative", "point_identity"):  # frames close in time
        assert "dt_s=(0.2,)" in repr(held_out_clips(TrainingRecipe("x", kind)))
    with pytest.raises(InvalidValueError, match="environments must not be 'crossing'"):
        clips_of_recipe(TrainingRecipe("x", world={"environments": ["crossing"]}), 0)
