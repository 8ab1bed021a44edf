"""Crops of sightings show the objects that were sighted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pictured_clips import PicturedClips
from synthetic_clips import SyntheticClips

pytest.importorskip("torch")

from coopsim.learn.clips.clip import Clip
from coopsim.learn.samples.sightings import Sightings, SightingSettings, changed, sighted_crops, sightings_of

SEEN = SightingSettings(least_returns=0, least_pixels=40)
COLOURS = np.random.default_rng(0).integers(100, 256, (5, 3))
"""Those in which `PicturedClips` paints its boxes, by number."""


def clip() -> Clip:
    return PicturedClips(frames=3, reach_m=12.0).clip(0)


def shares_of_own_colour(crops: list[np.ndarray | None], seen: Sightings) -> list[float]:
    return [
        float((np.abs(crop.astype(int) - COLOURS[number][:, None, None]) < 12).all(axis=0).mean())
        for crop, number in zip(crops, seen.identity, strict=True)
        if crop is not None
    ]


def test_a_crop_is_full_of_its_object() -> None:
    made = clip()
    seen = sightings_of(made, SEEN)
    crops = sighted_crops(made, seen, 16, 0.0)
    assert len(crops) == len(seen) and all(crop is None or crop.shape == (3, 16, 16) for crop in crops)
    shares = shares_of_own_colour(crops, seen)
    assert len(shares) > 3 and np.median(shares) > 0.4
    elsewhere = replace(seen, boxes=seen.boxes + 60 * np.eye(7)[2])
    assert sighted_crops(made, elsewhere, 16, 0.0) == [None] * len(seen), "above all pictures"


def test_some_are_taken_from_another_camera_but_show_the_same() -> None:
    made = clip()
    agent = made.scenes[0].agents[0]
    twice = tuple(
        replace(each, agents=tuple(replace(one, pictures=one.pictures * 2) for one in each.agents))
        for each in made.scenes
    )
    assert len(twice[0].agents[0].pictures) == 2 * len(agent.pictures)
    made = replace(made, scenes=twice)
    seen = sightings_of(made, SEEN)
    best, other = (sighted_crops(made, seen, 16, 0.0, rng) for rng in (None, np.random.default_rng(0)))
    for first, second in zip(best, other, strict=True):
        assert (first is None) == (second is None) and (first is None or np.array_equal(first, second))


def test_what_is_hidden_or_not_pictured_is_left_out() -> None:
    made = clip()
    seen = sightings_of(made, SEEN)
    pixels = [np.minimum(scene.pixels, 1) for scene in made.scenes]  # type: ignore[type-var]
    hidden = replace(made, scenes=tuple(replace(s, pixels=p) for s, p in zip(made.scenes, pixels, strict=True)))
    assert all(crop is None for crop in sighted_crops(hidden, seen, 16, 0.0))
    blind = SyntheticClips(frames=3, reach_m=12.0).clip(0)
    assert all(crop is None for crop in sighted_crops(blind, sightings_of(blind, SightingSettings()), 16, 0.0))


def test_a_changed_crop_is_another_picture_of_the_same_size() -> None:
    crop = np.random.default_rng(0).integers(0, 256, (3, 16, 16)).astype(np.uint8)
    made = [changed(crop, np.random.default_rng(seed)) for seed in range(30)]
    assert all(each.shape == crop.shape and each.dtype == np.uint8 for each in made)
    assert len({each.tobytes() for each in made}) == 30
    np.testing.assert_array_equal(made[3], changed(crop, np.random.default_rng(3)))
