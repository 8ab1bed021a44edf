"""Tiny networks with random weights in files, for tests of what is around networks."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import torch
from torch import nn

from coopsim.learn.weights import encoder_digest, make_cooperative, make_detector, save_weights

TINY: dict[str, Any] = {"cell_m": 2.4, "pillar_features": 4, "channels": [4, 4, 4], "layers": [0, 0, 0], "features": 8}
FUSIONS = ("attfuse", "fcooper", "pyramid", "where2comm")


@cache
def weights_folder(sweeps: int = 1, seed: int = 0) -> Path:
    """Return a folder with the weights `pillars`, `early` and one of each fusion; it is there as long as the tests."""
    folder = Path(mkdtemp(prefix="coopsim-tiny-"))
    detector = make_detector(TINY | {"sweeps": sweeps}, seed)
    _make_it_see(detector.head)
    for name in ("pillars", "early"):
        save_weights(folder / f"{name}.safetensors", detector, {"kind": "detector", "config": asdict(detector.config)})
    for name in FUSIONS:
        made: Any = make_cooperative({"fusion": name, "message_channels": 3, "features": 8}, seed)
        net, config = made
        net.head.load_state_dict(detector.head.state_dict())
        said = {"kind": "cooperative", "config": asdict(config), "encoder_digest": encoder_digest(detector)}
        save_weights(folder / f"{name}.safetensors", net, said)
    return folder


def _make_it_see(head: nn.Module) -> None:
    """Let a head with random weights find something: it starts sure that there is nothing."""
    with torch.no_grad():
        head.heat_of.bias.fill_(-1.0)  # type: ignore[union-attr, operator]


def learned(name: str, **settings: Any) -> dict[str, Any]:
    """Return the settings with which a learned policy takes tiny weights."""
    folder = weights_folder()
    own = {"weights": str(folder / f"{name}.safetensors"), "region_m": (48.0, 24.0)}
    if name in FUSIONS:
        own["detector_weights"] = str(folder / "pillars.safetensors")
    return own | settings


def tiny_detector() -> str:
    """Return the spec of the detector "pillars" with tiny weights."""
    return f"pillars(weights='{weights_folder() / 'pillars.safetensors'}')"
