"""How coop_fuse is fitted: what counts as right, and weights that are found again."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

FIT = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "fit_coop_fuse.py"))
"""What the script defines; it runs only as a program."""

OBJECT = np.array([[0, 0, 0.8, 4.5, 1.9, 1.6, 0]], dtype=float)


def test_a_box_on_an_object_that_a_likelier_one_is_on_already_is_a_false_alarm() -> None:
    tall, exact, elsewhere = OBJECT.copy(), OBJECT.copy(), OBJECT + np.array([30, 0, 0, 0, 0, 0, 0])
    tall[:, 5] = 3.0
    boxes = np.concatenate([tall, exact, elsewhere])
    assert FIT["_on_object"](boxes, np.array([0.9, 0.1, 1.0]), OBJECT).tolist() == [True, False, False]
    assert FIT["_on_object"](boxes, np.array([0.1, 0.9, 1.0]), OBJECT).tolist() == [False, True, False]
    assert FIT["_on_object"](boxes, np.ones(3), np.zeros((0, 7))).tolist() == [False] * 3


def test_a_likelier_box_takes_the_object_that_it_overlaps_most() -> None:
    objects = np.concatenate([OBJECT, OBJECT + np.array([2.0, 0, 0, 0, 0, 0, 0])])
    boxes = np.concatenate([objects[1:], objects[:1]])
    assert FIT["_on_object"](boxes, np.array([0.9, 0.1]), objects).tolist() == [True, True]


@pytest.mark.parametrize("power", [0.6, 1.0])
def test_weights_and_the_power_of_a_factor_are_found_again(power: float) -> None:
    rng = np.random.default_rng(0)
    features, factor = rng.normal(size=(60_000, 2)) * [1.0, 20.0], rng.uniform(0.02, 1, 60_000)
    right = rng.random(60_000) < factor**power * expit(0.5 + features @ [1.5, -0.05])
    bias, first, second, found = FIT["_logistic"](features, right, np.log(factor))
    assert [bias, first, 20 * second, found] == pytest.approx([0.5, 1.5, -1.0, power], abs=0.1)


def test_without_a_factor_it_is_a_logistic_regression() -> None:
    rng = np.random.default_rng(1)
    features = rng.normal(size=(40_000, 1))
    right = rng.random(40_000) < expit(-1 + 2 * features[:, 0])
    assert FIT["_logistic"](features, right) == pytest.approx([-1, 2], abs=0.06)
