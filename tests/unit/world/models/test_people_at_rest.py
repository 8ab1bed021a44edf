"""Models of people who stand and sit."""

from __future__ import annotations

import pytest

from coopsim.sensors.scene import is_closed
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import Model, make_models
from coopsim.world.models.built_in import built_in_models
from coopsim.world.models.catalogue import models_of

STANDING, SITTING = built_in_models("standing"), built_in_models("sitting")


@pytest.mark.parametrize("model", [*STANDING, *SITTING], ids=lambda model: model.name)
def test_they_are_closed_and_as_tight_as_labels_of_data_sets(model: Model) -> None:
    assert is_closed(model.vertices, model.faces) and len(model.poses) == 1
    length, width, height = model.size_m
    carries = any(thing in model.name for thing in ("pushchair", "dog", "umbrella"))
    assert min(length, width) >= 0.2 and (carries or max(length, width) <= 0.9)
    assert height < 1.4 if model in SITTING else height > 1.0


def test_nobody_who_walks_is_one_of_them_and_other_worlds_do_not_have_them() -> None:
    models = make_models(varied=True, at_rest=True)
    names = {model.name for model in (*STANDING, *SITTING)}
    for label in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD):
        assert not {models[k].name for k in models_of(models, label)} & names
    usual = make_models(varied=True)
    assert models[: len(usual)] == usual and {model.name for model in models[len(usual) :]} == names
