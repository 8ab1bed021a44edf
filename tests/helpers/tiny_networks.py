"""Tiny networks with random weights in files, for tests of what is around networks."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import torch

from coopsim.learn.weights import encoder_digest, make_cooperative, make_detector, save_weights

TINY: dict[str, Any] = {"cell_m": 2.4, "pillar_features": 4, "channels": [4, 4, 4], "layers": [0, 0, 0], "features": 8}
FUSIONS = ("attfuse", "cobevt", "disconet", "fcooper", "gsaf", "pyramid", "v2vnet", "v2x_vit", "where2comm")


@cache
def weights_folder(sweeps: int = 1, seed: int = 0) -> Path:
    """Return a folder with the weights `pillars`, `early` and one of each fusion; it is there as long as the tests."""
    folder = Path(mkdtemp(prefix="coopsim-tiny-"))
    detector = make_detector(TINY | {"sweeps": sweeps}, seed)
    make_it_see(detector)
    for name in ("pillars", "early"):
        save_weights(folder / f"{name}.safetensors", detector, {"kind": "detector", "config": asdict(detector.config)})
    for name in FUSIONS:
        made: Any = make_cooperative({"fusion": name, "message_channels": 3, "features": 8}, seed)
        net, config = made
        net.head.load_state_dict(detector.head.state_dict())
        said = {"kind": "cooperative", "config": asdict(config), "encoder_digest": encoder_digest(detector)}
        save_weights(folder / f"{name}.safetensors", net, said)
    return folder


def make_it_see(net: Any) -> None:
    """Let a random network see height: what has points above the ground is hot, and taken for a car."""
    with torch.no_grad():
        for weights in (*net.encoder.parameters(), *net.head.shared.parameters()):
            if weights.ndim > 1:  # no norm's
                weights.abs_().div_(weights.flatten(1).sum(1).mean())
        net.encoder.points.weight.zero_()[:, 5:7] = 1.0
        net.head.heat_of.weight.fill_(0.0)[0] = 5.0
        net.head.heat_of.bias.fill_(-3.0)


def learned(name: str, **settings: Any) -> dict[str, Any]:
    """Return the settings with which a learned policy takes tiny weights."""
    folder = weights_folder()
    own = {"weights": str(folder / f"{name}.safetensors"), "region_m": (48.0, 24.0), "least_score": 0.3}
    if name in FUSIONS:
        own["detector_weights"] = str(folder / "pillars.safetensors")
    return own | settings


def tiny_detector(sweeps: int = 1) -> str:
    """Return the spec of the detector "pillars" with tiny weights."""
    return f"pillars(weights='{weights_folder(sweeps) / 'pillars.safetensors'}', least_score=0.3)"
