"""Models are chosen as often as their shares say, and equal shares draw what they always drew."""

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import make_models
from coopsim.world.models.catalogue import draw_models, models_of

MODELS = make_models(varied=True)


def test_equal_shares_take_one_whole_number_each() -> None:
    models = make_models()
    fitting = models_of(models, ObjectClass.CAR)
    expected = fitting[np.random.default_rng(5).integers(len(fitting), size=40)]
    rng = np.random.default_rng(5)
    one_by_one = [draw_models(rng, models, fitting, 1)[0] for _ in range(40)]
    np.testing.assert_array_equal(one_by_one, expected)
    np.testing.assert_array_equal(draw_models(np.random.default_rng(5), models, fitting, 40), expected)


@pytest.mark.parametrize("cls", ObjectClass, ids=lambda cls: cls.title)
def test_each_is_drawn_as_often_as_its_share_says(cls: ObjectClass) -> None:
    fitting = models_of(MODELS, cls, parked=True)
    drawn = draw_models(np.random.default_rng(0), MODELS, fitting, 200_000)
    share = np.array([MODELS[k].share for k in fitting])
    found = np.bincount(drawn, minlength=len(MODELS))[fitting] / len(drawn)
    np.testing.assert_allclose(found, share / share.sum(), atol=0.005)


def test_what_only_stands_is_chosen_for_parked_vehicles_alone() -> None:
    for cls in ObjectClass:
        moving, parked = models_of(MODELS, cls), models_of(MODELS, cls, parked=True)
        assert not any(MODELS[k].stands for k in moving)
        assert set(parked) - set(moving) == {k for k in parked if MODELS[k].stands}
    assert any(MODELS[k].stands for k in models_of(MODELS, ObjectClass.CAR, parked=True))


def test_a_class_without_a_model_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="no model of class 'bus', only of bicycle"):
        models_of([model for model in MODELS if model.label == ObjectClass.BICYCLE], ObjectClass.BUS)
