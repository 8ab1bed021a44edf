"""The example that learns what to say: gains are counted rightly, and When2com's rule is silent without a link."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import SELECTIONS
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate, Tracks

EXAMPLE = Path(__file__).parents[2] / "examples" / "21_learn_what_to_say.py"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setattr(SELECTIONS, "_entries", dict(SELECTIONS._entries))
    return runpy.run_path(str(EXAMPLE))


def rows(x: list[float]) -> np.ndarray:
    return np.array([[each, 0.0, 0.8, 4.5, 1.9, 1.6, 0.0] for each in x]).reshape(-1, 7)


def boxes(x: list[float], *score: float) -> Detections:
    return Detections(Boxes3D.from_array(rows(x)), np.array(score or [0.5] * len(x)), np.zeros(len(x), dtype=int))


def observe(found: Detections, *inbox: Message, x: float = 0.0) -> Observation:
    return Observation(0, PoseEstimate(np.array([x, 0.0, 0.0, 0.0])), Odometry(np.zeros(4)), found, inbox=inbox)


def test_a_gain_is_a_missed_object_or_less_a_false_one(example: dict[str, Any]) -> None:
    """The receiver stands 10 m ahead of the sender: it tracks the object at 20 m, and misses those at 40 and 60 m."""
    truth = {"box": rows([10.0, 30.0, 50.0]), "counts": np.array([True, True, False]), "in_region": np.ones(3, bool)}
    tracks = Tracks(
        np.array([1]), Boxes3D.from_array(rows([10.0])), np.zeros((1, 2)), np.array([0.9]), np.zeros(1, int)
    )
    local_SE3_sender = SE3.from_xyz_yaw([-10.0, 0.0, 0.0], 0.0)
    found = boxes([20.0, 40.0, 60.0, 80.0, 200.0])  # known, missed, does not count, nothing there, outside the region
    assert example["gains"](found, local_SE3_sender, tracks, truth).tolist() == [0.0, 1.0, 0.0, -1.0, 0.0]
    assert example["gains"](boxes([]), local_SE3_sender, tracks, truth).tolist() == []


@pytest.mark.parametrize(("links", "sent"), [(True, [1, 0]), (False, [])])
def test_when2com_speaks_to_a_link_alone(example: dict[str, Any], links: bool, sent: list[int]) -> None:
    """The handshake is made to weigh how many objects the keys have: the sender has two, the receiver one or four."""
    rule = example["When2com"](np.random.default_rng(0))
    for layer in (rule.net.query, rule.net.key):
        torch.nn.init.zeros_(layer.weight)
        torch.nn.init.zeros_(layer.bias)
    rule.net.query.weight.data[0, 0], rule.net.key.weight.data[0, 1] = 1.0, 100.0
    receiver = ShareDetections().message("cav_1", observe(boxes([50.0] if links else [50.0, 60.0, 70.0, 80.0]), x=30.0))
    assert receiver is not None
    seen = observe(boxes([10.0, 20.0], 0.3, 0.8))
    assert rule.order("cav_0", seen).tolist() == [1, 0], "alone, nobody can be linked, and nothing is held back"
    rule.hear(observe(boxes([]), receiver), DecodeOnce())
    assert rule.order("cav_0", seen).tolist() == sent
