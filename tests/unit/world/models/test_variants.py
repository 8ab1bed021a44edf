"""Variants: the plain models before them are as they were, sizes spread as nuScenes', parked ones have room."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from actor_shapes.attachments import RETRO_PLATE

import coopsim
from coopsim.envs.simulated.record_episode import recorded_scenario
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import make_models
from coopsim.world.models.catalogue import models_of
from coopsim.world.models.model import BRIGHTEST, Model
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import PlayedWorld
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.world import World

PLAIN, MODELS = make_models(), make_models(varied=True)
VARIANTS = MODELS[len(PLAIN) :]
VEHICLES = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS)

PUBLISHED = {
    ObjectClass.CAR: ((4.62, 0.46), (1.95, 0.19), (1.73, 0.24)),
    ObjectClass.TRUCK: ((6.93, 2.17), (2.51, 0.45), (2.84, 0.84)),
    ObjectClass.BUS: ((11.23, 2.07), (2.93, 0.33), (3.47, 0.52)),
    ObjectClass.MOTORCYCLE: ((2.11, 0.32), (0.77, 0.17), (1.47, 0.23)),
    ObjectClass.BICYCLE: ((1.70, 0.26), (0.60, 0.16), (1.28, 0.34)),
    ObjectClass.PEDESTRIAN: ((0.73, 0.19), (0.67, 0.13), (1.77, 0.18)),
    ObjectClass.CHILD: ((0.53, 0.15), (0.51, 0.14), (1.38, 0.25)),
}
"""Means and standard deviations of length, width and height (m) of nuScenes' labelled boxes."""

AS_GOLDEN = "efc12ac5e05e5ac7fa63965ae98d1aeffbd8ca51f1913974f3f613026d23bbac"


def largest_m(models: tuple[Model, ...], label: ObjectClass) -> Floats:
    most: Floats = np.array([model.size_m for model in models if model.label == label]).max(axis=0)
    return most


def test_plain_models_are_what_they_were_before_there_were_variants() -> None:
    digest = hashlib.sha256()
    for model in PLAIN:
        digest.update(f"{model.name} {model.label} {model.cycle_m:.6f} {model.share} {model.stands}".encode())
        for part in (model.poses, model.size_m, model.tint, model.reflectivity):
            digest.update((np.round(part, 6) + 0.0).tobytes())
        for whole in (model.faces, model.color, model.accented):
            digest.update(whole.tobytes())
    assert digest.hexdigest() == AS_GOLDEN


def test_variants_come_after_the_plain_models_and_have_names_of_their_own() -> None:
    assert all(one is other for one, other in zip(MODELS, PLAIN, strict=False))
    assert len({model.name for model in MODELS}) == len(MODELS) > 3 * len(PLAIN)


@pytest.mark.parametrize("cls", PUBLISHED, ids=lambda cls: cls.title)
def test_heights_and_lengths_spread_as_published(cls: ObjectClass) -> None:
    """Within the published spread, and not much narrower; people's lengths are of whole steps, riders' heights of all.

    Published boxes of two-wheelers include many without a rider, and those of people not the whole step.
    """
    fitting = models_of(MODELS, cls)
    weight = np.array([MODELS[k].share for k in fitting])
    size = np.array([MODELS[k].size_m for k in fitting])
    mean, spread = np.array(PUBLISHED[cls]).T
    ours = np.average(size, axis=0, weights=weight)
    ours_spread = np.sqrt(np.average((size - ours) ** 2, axis=0, weights=weight))
    two_wheels = cls in (ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE)
    compared = [0] if two_wheels else [2] if cls in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD) else [0, 2]
    assert (np.abs(ours - mean)[compared] < 0.3 * spread[compared]).all(), ours
    assert (ours_spread > 0.4 * spread)[compared].all() and (ours_spread < 1.25 * spread)[compared].all(), ours_spread
    assert (np.abs(ours - mean) < 1.5 * spread).all() or two_wheels


def test_adults_and_children_are_as_tall_as_people_are() -> None:
    alone = [model for model in VARIANTS if "umbrella" not in model.name and "wheelchair" not in model.name]
    adults, children = (
        np.array([model.size_m[2] for model in alone if model.label == cls])
        for cls in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)
    )
    assert adults.min() >= 1.50 and adults.max() <= 1.96
    assert children.min() >= 0.9 and children.max() <= 1.5


@pytest.mark.parametrize("cls", VEHICLES, ids=lambda cls: cls.title)
def test_no_variant_needs_more_room_on_the_road_than_the_largest_plain_models(cls: ObjectClass) -> None:
    alike = (ObjectClass.CAR, ObjectClass.VAN) if cls <= ObjectClass.VAN else (cls,)
    most = np.max([largest_m(PLAIN, each) for each in alike], axis=0)
    assert (largest_m(MODELS, cls)[:2] <= most[:2] + 1e-9).all()


def test_vehicles_have_plates_that_shine_back() -> None:
    for model in VARIANTS:
        if model.label in VEHICLES:
            assert (model.reflectivity > 1).sum() == 16, model.name  # a prism of eight triangles at either end
    assert max(model.reflectivity.max() for model in MODELS) <= BRIGHTEST
    assert max(model.reflectivity.max() for model in PLAIN) <= 1 < RETRO_PLATE.reflectivity


def test_variants_have_hardly_more_triangles() -> None:
    for cls in ObjectClass:
        faces, weight = (
            np.array([getter(MODELS[k]) for k in models_of(MODELS, cls)])
            for getter in (lambda model: len(model.faces), lambda model: model.share)
        )
        plain = np.mean([len(model.faces) for model in PLAIN if model.label == cls])
        assert np.average(faces, weights=weight) < 1.15 * plain, cls


def test_only_parked_vehicles_have_open_doors() -> None:
    seen = set()
    for seed in range(4):
        world = World(make_scenario("parking_street", detail="full", parked=30), seed)
        rows = world._traffic.fleet.rows
        stands = np.array([model.stands for model in world.models])[rows["model"]]
        assert (rows["driver"][stands] == PARKED).all()
        seen |= set(rows["model"][stands].tolist())
    assert len(seen) >= 3  # so that the test sees some


def test_a_recording_of_variants_plays_back(tmp_path: Path) -> None:
    path = coopsim.record("crossing", tmp_path / "run", seed=2, max_cycles=3, detail="full")
    episode = Episode(path)
    again, world = PlayedWorld(episode, recorded_scenario(episode)), World(make_scenario("crossing", detail="full"), 2)
    for step in range(3):
        actors, expected = again.actors(), world.actors()
        np.testing.assert_array_equal(actors.model, expected.model)
        np.testing.assert_array_equal(actors.color, expected.color)
        assert actors.model.max() >= len(PLAIN), step
        again.step(0.1)
        world.step(0.1)
