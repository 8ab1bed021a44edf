"""Tiny networks with random weights in files, for tests of what is around networks."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import torch

from coopsim.learn.weights import (
    encoder_digest,
    make_network,
    save_weights,
)
from coopsim.nn.camera.picture_batch import GEOMETRY

TINY: dict[str, Any] = {"cell_m": 2.4, "pillar_features": 4, "channels": [4, 4, 4], "layers": [0, 0, 0], "features": 8}
TINY_PICTURES: dict[str, Any] = {"width": 8, "picture_features": 2, "depth_bins": 16} | {
    name: TINY[name] for name in ("cell_m", "channels", "layers", "features")
}
QUERIES = ("cooptrack", "univ2x")
INTEGRATED = "vic_integrated"
FUSIONS = (
    "attfuse",
    "cobevt",
    "disconet",
    "fcooper",
    "ff_tracking",
    "gsaf",
    "pyramid",
    "v2vnet",
    "v2x_vit",
    "where2comm",
)


@cache
def weights_folder(sweeps: int = 1, seed: int = 0) -> Path:
    """Return a folder with the weights `pillars`, `early`, `lift_splat`, `points_and_pictures`, `point_identity` and
    one of each fusion, of maps and of queries, and `vic_integrated`; it is there as long as the tests.
    """
    folder = Path(mkdtemp(prefix="coopsim-tiny-"))
    detector = make_network("detector", TINY | {"sweeps": sweeps}, seed)
    make_it_see(detector)
    for name in ("pillars", "early"):
        save_weights(folder / f"{name}.safetensors", detector, {"kind": "detector", "config": asdict(detector.config)})
    save_pictures(folder / "lift_splat.safetensors", detector, seed)
    save_both(folder / "points_and_pictures.safetensors", detector, seed)
    looks = make_network("point_identity", {"widths": [4, 4, 8, 8, 8], "dim": 6, "points": 32}, seed)
    said = {"kind": "point_identity", "config": asdict(looks.config)}
    save_weights(folder / "point_identity.safetensors", looks, said)
    for name in QUERIES:
        save_queries(folder / f"{name}.safetensors", detector, name, seed)
    for name in FUSIONS:
        flow = 4 if name == "ff_tracking" else 0
        sizes = {"fusion": name, "message_channels": 3, "features": 8, "flow": flow}
        net = make_network("cooperative", sizes, seed)
        if flow:
            torch.nn.init.normal_(net.flow.last.weight, generator=torch.Generator().manual_seed(seed))
        net.head.load_state_dict(detector.head.state_dict())
        said = {"kind": "cooperative", "config": asdict(net.config), "encoder_digest": encoder_digest(detector)}
        save_weights(folder / f"{name}.safetensors", net, said)
        if flow:
            save_integrated(folder / f"{INTEGRATED}.safetensors", detector, net, asdict(net.config), seed)
    return folder


def save_integrated(path: Path, detector: Any, cooperative: Any, config: dict[str, Any], seed: int = 0) -> None:
    """Write a network of integrated tracking on a cooperative one, that changes a little what that one finds."""
    sizes = {"width": 16, "heads": 2, "points": 2, "decoder_layers": 1, "places": 32}
    net = make_network("integrated", {**sizes, "cooperative": config}, seed)
    net.cooperative.load_state_dict(cooperative.state_dict())
    draw = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        zeros = [net.encoder.added, net.encoder.enhance.out]
        for branch in (net.detection, net.prediction):
            zeros += [branch.heads.classes[-1], branch.heads.box[-1]]
        for layer in zeros:
            layer.weight.copy_(0.01 * torch.randn(layer.weight.shape, generator=draw))
    said = {"kind": "integrated", "config": asdict(net.config), "encoder_digest": encoder_digest(detector)}
    save_weights(path, net, said)


def save_queries(path: Path, detector: Any, fusion: str, seed: int = 0) -> None:
    """Write a network of queries on a detector, that changes a little what the detector finds."""
    net = make_network("queries", {"fusion": fusion, "features": 8, "width": 32, "heads": 2}, seed)
    with torch.no_grad():
        for head in (net.agent.heads.classes, net.agent.heads.box):
            weights = head[-1].weight
            weights.copy_(0.01 * torch.randn(weights.shape, generator=torch.Generator().manual_seed(seed)))
    said = {"kind": "queries", "config": asdict(net.config), "encoder_digest": encoder_digest(detector)}
    save_weights(path, net, said)


def make_it_see(net: Any) -> None:
    """Let a random network see height: what has points above the ground is hot, and taken for a car."""
    with torch.no_grad():
        for weights in (*net.encoder.parameters(), *net.head.shared.parameters()):
            if weights.ndim > 1:  # no norm's
                weights.abs_().div_(weights.flatten(1).sum(1).mean())
        net.encoder.points.weight.zero_()[:, 5:7] = 1.0
        net.head.heat_of.weight.fill_(0.0)[0] = 5.0
        net.head.heat_of.bias.fill_(-3.0)


def save_pictures(path: Path, detector: Any, seed: int = 0) -> None:
    """Write an encoder of pictures beside a detector, whose scales and head it has."""
    net = make_network("pictures", TINY_PICTURES, seed)
    for part in ("scales", "sides", "join"):
        getattr(net.encoder, part).load_state_dict(getattr(detector.encoder, part).state_dict())
    net.head.load_state_dict(detector.head.state_dict())
    let_it_see_light(net)
    said = {"kind": "pictures", "config": asdict(net.config), "encoder_digest": encoder_digest(detector)}
    save_weights(path, net, said)


def save_both(path: Path, detector: Any, seed: int = 0) -> None:
    """Write an encoder of points and pictures beside a detector, which sees what that one sees."""
    net = make_network("points_and_pictures", {"pictures": TINY_PICTURES}, seed)
    net.encoder.points.load_state_dict(detector.encoder.state_dict())
    net.head.load_state_dict(detector.head.state_dict())
    with torch.no_grad():
        net.encoder.merge.second.kernels.fill_(0.5)
    said = {"kind": "points_and_pictures", "config": asdict(net.config), "encoder_digest": encoder_digest(detector)}
    save_weights(path, net, said)


def let_it_see_light(net: Any) -> None:
    """Let a random network on pictures see light: what is bright is hot, on the ground where it seems to be."""
    pictures, config = net.encoder.pictures.net, net.config
    with torch.no_grad():
        for part in (pictures.backbone, pictures.hidden, pictures.features):
            for name, weights in part.named_parameters():
                if weights.ndim > 1:  # no norm's
                    weights.abs_().div_(weights.flatten(1).sum(1).mean())
                elif "bias" in name:
                    weights.zero_()
        pictures.backbone.middle[0][0].weight[:, -GEOMETRY:] = 0.0
        pictures.hidden[0].weight[:, config.width :] = 0.0
        pictures.features.weight.mul_(80.0)
        for zeros in (pictures.features.bias, pictures.depth.weight, pictures.depth.bias):
            zeros.zero_()
        net.encoder.scales[0][0][0].weight[:, config.picture_features :] = 0.0


def learned(name: str, **settings: Any) -> dict[str, Any]:
    """Return the settings with which a learned policy takes tiny weights."""
    folder, fusion = weights_folder(), {"dino_codt": "gsaf"}.get(name, name)
    own = {"weights": str(folder / f"{fusion}.safetensors"), "region_m": (48.0, 24.0), "least_score": 0.3}
    both = settings.get("sensors") == "both"
    if fusion in (*FUSIONS, INTEGRATED) or both:
        own["picture_weights"] = str(folder / f"{'points_and_pictures' if both else 'lift_splat'}.safetensors")
    if fusion in (*FUSIONS, *QUERIES, INTEGRATED):
        own["detector_weights"] = str(folder / "pillars.safetensors")
    return own | settings


def tiny_detector(sweeps: int = 1) -> str:
    """Return the spec of the detector "pillars" with tiny weights."""
    return f"pillars(weights='{weights_folder(sweeps) / 'pillars.safetensors'}', least_score=0.3)"


def tiny_looks() -> str:
    """Return the path of tiny weights of the embedder "point_identity"."""
    return str(weights_folder() / "point_identity.safetensors")


@cache
def tiny_picture_identity() -> str:
    """Return the path of tiny weights of the embedder "picture_identity"."""
    net = make_network("picture_identity", {"edge_px": 16, "channels": [4, 4, 8, 8], "dim": 6})
    path = weights_folder() / "picture_identity.safetensors"
    save_weights(path, net, {"kind": "picture_identity", "config": asdict(net.config)})
    return str(path)


def tiny_picture_detector(name: str = "lift_splat", **settings: Any) -> str:
    """Return the spec of the detector "lift_splat" or "points_and_pictures" with tiny weights."""
    given = "".join(f", {key}={value}" for key, value in ({"least_score": 0.3} | settings).items())
    return f"{name}(weights='{weights_folder() / f'{name}.safetensors'}'{given})"
