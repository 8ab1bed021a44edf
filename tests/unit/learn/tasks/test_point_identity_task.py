"""Training of identity from points: it learns shapes, and ends as a file of weights with a card."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_clips import SyntheticClips

from coopsim.errors import CoopsimError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.train import train
from coopsim.learn.weights import load_point_identity

TINY = {"widths": [8, 8, 8, 8, 16], "dim": 8, "points": 32}

RECIPE = TrainingRecipe(
    "tiny", "point_identity", steps=60, batch=4, block=4, passes=4, lr=0.01, average=0.8, precision="float32",
    validate_every=60, held_out=3, network=TINY,
)  # fmt: skip


class LongAndShort:
    """Clips of objects that differ in length alone."""

    def clip(self, index: int) -> Clip:
        made = SyntheticClips(agents=2, objects=4, frames=3, reach_m=30.0).clip(index)
        length = np.linspace(1.0, 8.0, 4)
        for scene in made.scenes:
            for agent in scene.agents:
                _stretch(agent.points, scene.boxes, agent.xyz_yaw, length)
            scene.boxes[:, 3] = length
        return made


def _stretch(points: np.ndarray, boxes: np.ndarray, pose: np.ndarray, length: np.ndarray) -> None:
    """Stretch the points of each box, of which there are 40, in place."""
    for k, box in enumerate(boxes):
        own = points[40 * k : 40 * (k + 1)]
        yaw = box[6] - pose[3]
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        dx, dy = box[:2] - pose[:2]
        middle, way = np.array([cos * dx + sin * dy, cos * dy - sin * dx]), np.array([np.cos(yaw), np.sin(yaw)])
        own[:, :2] += np.outer((own[:, :2] - middle) @ way * (length[k] / box[3] - 1), way)


def test_it_learns_to_tell_lengths_apart(tmp_path: Path) -> None:
    net = load_point_identity(train(RECIPE, tmp_path, source=LongAndShort()))
    assert net.dim == 8
    card = json.loads((tmp_path / "card.json").read_text())
    assert set(card["losses"]) == {"loss", "positive", "triplet"}
    assert card["held_out"]["AUC within"] > 0.8 and card["held_out"]["AUC across"] > 0.8
    again = replace(RECIPE, name="again", steps=1, start=str(tmp_path / "tiny.safetensors"), network={}, lr=1e-9)
    kept = load_point_identity(train(again, tmp_path / "again", source=LongAndShort()))
    assert kept.config == net.config
    for name, value in kept.state_dict().items():
        assert value.numpy() == pytest.approx(net.state_dict()[name].numpy(), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"samples": {"merged": 1.0}}, "merged"),
        ({"network": {"fusion": "gsaf"}}, "fusion"),
        ({"start": "pillars"}, "must be weights of the kind 'point_identity', is 'detector'"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        train(replace(RECIPE, **changes), tmp_path, source=SyntheticClips())  # type: ignore[arg-type]
