"""Training of identity from pictures: it learns colours, and ends as weights that the embedder takes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pictured_clips import PicturedClips
from synthetic_clips import SyntheticClips

from coopsim.detection.embedder import make_embedder
from coopsim.errors import CoopsimError
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.recipe import TrainingRecipe, find_recipe
from coopsim.learn.train import train
from coopsim.learn.weights import load_picture_identity

TINY = {"edge_px": 16, "channels": [8, 8, 12, 16], "dim": 8}

RECIPE = TrainingRecipe(
    "tiny", "picture_identity", steps=60, batch=4, block=4, passes=4, lr=0.01, average=0.8, precision="float32",
    validate_every=60, held_out=3, network=TINY, samples={"least_returns": 0, "least_pixels": 40},
)  # fmt: skip
CLIPS = PicturedClips(frames=3, reach_m=12.0)


def test_it_learns_to_tell_colours_apart(tmp_path: Path) -> None:
    net = load_picture_identity(train(RECIPE, tmp_path, source=CLIPS))
    card = json.loads((tmp_path / "card.json").read_text())
    assert set(card["losses"]) == {"loss", "positive", "triplet"}
    assert card["held_out"]["AUC within"] > 0.8 and card["held_out"]["AUC across"] > 0.8
    assert make_embedder(f"picture_identity(weights='{tmp_path / 'tiny.safetensors'}')").dim == net.dim == 8
    again = replace(RECIPE, name="again", steps=1, start=str(tmp_path / "tiny.safetensors"), network={}, lr=1e-9)
    kept = load_picture_identity(train(again, tmp_path / "again", source=CLIPS))
    assert kept.config == net.config
    for name, value in kept.named_parameters():
        assert value.detach().numpy() == pytest.approx(net.state_dict()[name].numpy(), abs=1e-2)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"samples": {"merged": 1.0}}, "merged"),
        ({"network": {"widths": [4]}}, "widths"),
        ({"start": "pillars"}, "must be weights of the kind 'picture_identity', is 'detector'"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        train(replace(RECIPE, **changes), tmp_path, source=SyntheticClips())  # type: ignore[arg-type]


def test_without_cameras_there_is_nothing_to_learn_from(tmp_path: Path) -> None:
    with pytest.raises(CoopsimError, match=r"world\.cameras must name rigs with kind: picture_identity"):
        train(RECIPE, tmp_path)


def test_the_recipe_shares_its_clips_with_that_of_the_encoder_of_pictures() -> None:
    assert find_recipe("picture_identity").world == find_recipe("lift_splat").world
    assert WorldRecipe(**find_recipe("picture_identity").world).cameras
