"""Recipes: the shipped ones can be read, and mistakes name the line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.learn.recipe import RECIPES, TrainingRecipe, find_recipe


@pytest.mark.parametrize("name", RECIPES)
def test_shipped_recipes_are_complete(name: str) -> None:
    recipe = find_recipe(name)
    assert recipe.name == name
    assert TrainingRecipe(**json.loads(json.dumps(recipe.as_data()))) == recipe


@pytest.mark.parametrize("kind", ["detector", "pictures", "points_and_pictures"])
def test_a_teacher_is_for_fusions_alone(kind: str) -> None:
    with pytest.raises(InvalidValueError, match=f"teacher must be none with kind: {kind}, got 'early'"):
        TrainingRecipe("x", kind, teacher="early")
    assert TrainingRecipe("x", "cooperative", teacher="early").teacher == "early"


def test_unknown_kinds_are_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown kind 'picture'\. Did you mean 'pictures'"):
        TrainingRecipe("x", "picture")


def test_own_files_and_their_mistakes(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("kind: detector\nsteps: 5\nworld: {rain_share: 0.5}\n")
    assert find_recipe(path) == TrainingRecipe("mine", steps=5, world={"rain_share": 0.5})
    path.write_text("kind: detector\nsteps: -5\n")
    with pytest.raises(InvalidValueError, match=r"mine.yaml:2: recipe: steps must be an integer >= 1, got -5"):
        find_recipe(path)
    path.write_text("kind: detector\nstep: 5\n")
    with pytest.raises(UnknownNameError, match=r"mine.yaml:2: unknown recipe option 'step'. Did you mean 'steps'"):
        find_recipe(path)
    with pytest.raises(UnknownNameError, match=r"unknown recipe 'piller'. Did you mean 'pillars'"):
        find_recipe("piller")


def test_a_file_names_code_only_if_trusted_and_finds_it_beside_itself(tmp_path: Path) -> None:
    path, fusion = tmp_path / "mine.yaml", tmp_path / "own_fusion.py"
    path.write_text("kind: cooperative\nnetwork: {fusion: 'own_fusion.py:Own'}\n")
    with pytest.raises(InvalidValueError, match=r"mine.yaml:2: a recipe's file names code to run, 'own_.*--trust"):
        find_recipe(path)
    assert find_recipe(path, trust=True).network == {"fusion": "own_fusion.py:Own"}
    fusion.touch()
    assert find_recipe(path, trust=True).network == {"fusion": f"{fusion}:Own"}
    assert find_recipe("attfuse").changed(**{"network.fusion": "x.py:Own"}).network["fusion"] == "x.py:Own"


def test_options_replace_values_and_parts_of_mappings() -> None:
    recipe = TrainingRecipe("x", world={"a": 1, "b": 2}).changed(**{"lr": 0.5, "world.b": 3, "world.c": 4})
    assert (recipe.lr, recipe.world) == (0.5, {"a": 1, "b": 3, "c": 4})
    with pytest.raises(UnknownNameError, match="unknown recipe option 'wrld'"):
        recipe.changed(**{"wrld.b": 3})
    with pytest.raises(InvalidValueError, match="lr must be a finite number > 0"):
        recipe.changed(lr="fast")
