"""The command of a card repeats its training, and names no folder."""

import shlex

import torch

from coopsim.cli.entry import make_parser
from coopsim.learn.loop.training_log import command_of, make_card
from coopsim.learn.recipe import TrainingRecipe, find_recipe


def test_the_command_says_what_differs_from_the_shipped_recipe() -> None:
    assert command_of(find_recipe("pillars"), 2) == "coopsim train pillars --out pillars --seed 2"
    changed = find_recipe("attfuse").changed(steps=7, detector="a/b/pillars.safetensors", world={"rain_share": 0.5})
    command = command_of(changed, 0)
    parsed = make_parser().parse_args(shlex.split(command)[1:])
    assert (parsed.recipe, parsed.steps, parsed.option) == ("attfuse", 7, [("world", {"rain_share": 0.5})])
    assert command_of(TrainingRecipe("mine"), 0) == "coopsim train mine.yaml --out mine --seed 0"


def test_a_card_has_mean_losses_and_the_last_look() -> None:
    log = [{"step": k, "kind": "losses", "loss": float(k)} for k in range(1, 201)]
    for line in log[150::2]:
        line["rare"] = 2.0  # not every step has every loss
    log += [{"step": k, "kind": "validation", "AP@0.5": k / 1000} for k in (100, 200)]
    card = make_card(TrainingRecipe("x"), 0, torch.device("cpu"), 10, log)
    assert card["losses"] == {"loss": 150.5, "rare": 2.0} and card["held_out"] == {"AP@0.5": 0.2}
