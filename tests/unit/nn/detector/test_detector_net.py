"""A network comes back from its file, and states covariances."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
from tiny_networks import TINY

from coopsim.detection.network_detectors import PillarsDetector
from coopsim.errors import CoopsimError
from coopsim.learn.weights import load_detector, make_network, save_weights
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig


def test_encoder_and_head_come_back_from_a_file(tmp_path: Path) -> None:
    net, path = make_network("detector", TINY), tmp_path / "tiny.safetensors"
    save_weights(path, net, {"kind": "detector", "config": asdict(net.config)})
    assert {name.partition(".")[0] for name in load_detector(path).state_dict()} == {"encoder", "head"}
    assert PillarsDetector(str(path)).states_covariance


def test_an_unknown_head_is_refused() -> None:
    with pytest.raises(CoopsimError, match=r"head.*centre"):
        DetectorNet(EncoderConfig(head="anchor"))
