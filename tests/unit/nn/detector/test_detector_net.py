"""The head that a network's config names is the one that it has, in files and in the detector as well."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
from tiny_networks import TINY

from coopsim.detection.pillars_detector import PillarsDetector
from coopsim.errors import CoopsimError
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.train import make_task
from coopsim.learn.weights import load_detector, make_detector, save_weights
from coopsim.nn.detector.anchor_head import AnchorHead
from coopsim.nn.detector.centre_head import CentreHead
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig


def saved(folder: Path, head: str) -> str:
    net, path = make_detector(TINY | {"head": head}), folder / f"{head}.safetensors"
    save_weights(path, net, {"kind": "detector", "config": asdict(net.config)})
    return str(path)


@pytest.mark.parametrize(
    ("head", "kind", "direction"),
    [("centre", CentreHead, None), ("anchor", AnchorHead, False), ("anchor_direction", AnchorHead, True)],
)
def test_each_head_comes_back_from_a_file(head: str, kind: type, direction: bool | None, tmp_path: Path) -> None:
    net = load_detector(saved(tmp_path, head))
    assert isinstance(net.head, kind) and getattr(net.head, "direction", None) is direction
    assert {name.partition(".")[0] for name in net.state_dict()} == {"encoder", "head"}


def test_covariances_are_announced_by_the_head_that_has_them(tmp_path: Path) -> None:
    stated = {head: PillarsDetector(saved(tmp_path, head)).states_covariance for head in ("centre", "anchor")}
    assert stated == {"centre": True, "anchor": False}


def test_an_unknown_head_is_refused() -> None:
    with pytest.raises(CoopsimError, match=r"head.*centre"):
        DetectorNet(EncoderConfig(head="centre_point"))


def test_a_fusion_is_not_trained_on_anchors(tmp_path: Path) -> None:
    recipe = TrainingRecipe(
        "none", kind="cooperative", detector=saved(tmp_path, "anchor"), network={"fusion": "fcooper"}
    )
    with pytest.raises(CoopsimError, match="head 'centre'"):
        make_task(recipe, 0)
