"""Weights of networks in files: written small, found by name or path, and checked before they are used."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from torch import nn

import coopsim
from coopsim.config.checked_entry import plain
from coopsim.config.load import load
from coopsim.errors import InvalidValueError, UnknownNameError, WeightsNotShippedError
from coopsim.learn.recipe import RECIPES
from coopsim.learn.tensor_file import read_header, read_tensors, write_tensors
from coopsim.nn.camera.lift_splat import LiftSplatConfig
from coopsim.nn.camera.picture_detector import PictureDetectorNet, PointsAndPicturesNet
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesConfig
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig, CooperativeNet
from coopsim.nn.covariance.covariance_net import CovarianceConfig, CovarianceNet
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.nn.identity.picture_identity_net import PictureIdentityConfig, PictureIdentityNet
from coopsim.nn.identity.point_encoder import PointIdentityConfig, PointIdentityNet
from coopsim.nn.integrated.integrated_net import IntegratedConfig, IntegratedNet
from coopsim.nn.queries.query_net import QueryConfig, QueryNet
from coopsim.support.weights_watch import note_weights
from coopsim.types.taxonomy import CLASS_NAMES

SUFFIX = ".safetensors"

N = TypeVar("N", bound=nn.Module)

_SHIPPED = Path(coopsim.__file__).parent / "weights"
_LOADED = 8
_DECIDES = ("kind", "config", "classes", "encoder_digest")
"""Texts of a file that are part of its digest."""


def shipped_weights() -> tuple[str, ...]:
    """Return the names of the weights that come along."""
    return tuple(sorted(path.stem for path in _SHIPPED.glob(f"*{SUFFIX}")))


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of weights that come along, by name, or of others, by path.

    Raises:
        UnknownNameError: there is neither.
        WeightsNotShippedError: there are none, but a recipe to train them.
    """
    path = Path(name_or_path).expanduser()
    if path.suffix == SUFFIX:
        return note_weights(name_or_path, path)
    name, shipped = str(name_or_path), shipped_weights()
    if name not in shipped:
        if name in RECIPES:
            raise WeightsNotShippedError(
                f"no weights of {name!r} ship yet: train them with 'coopsim train {name} --out DIR', and give the path "
                f"DIR/{name}{SUFFIX} in place of the name"
            )
        raise UnknownNameError("weights", name, shipped, f"(or the path of a file *{SUFFIX})")
    return note_weights(name, _SHIPPED / f"{name}{SUFFIX}")


def load_detector(name_or_path: str | Path = "pillars") -> DetectorNet:
    """Return the network of one agent with weights, ready to be used; shared by all who ask, so not to be changed.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, or holds something else.
    """
    path = find_weights(name_or_path)
    return _loaded_detector(path, digest(path))


def load_cooperative(name_or_path: str | Path, detector: DetectorNet | None = None) -> CooperativeNet:
    """Return a `CooperativeNet` with weights, ready to be used; shared by all who ask, so not to be changed.

    Args:
        name_or_path: of the weights.
        detector: whose features it will get; it must have the encoder that the weights were trained on.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, or was trained on another encoder.
    """
    path = find_weights(name_or_path)
    texts = read_texts(path)
    _require_kind(path, texts, "cooperative")
    _require_encoder(path, texts, detector)
    return _loaded_cooperative(path, digest(path))


def load_pictures(name_or_path: str | Path = "lift_splat", detector: DetectorNet | None = None) -> PictureDetectorNet:
    """Return the network of an agent with cameras, ready to be used; shared by all who ask, so not to be changed.

    Args:
        name_or_path: of the weights.
        detector: of points, whose features it is to have.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, or was trained beside another encoder.
    """
    net = _load_beside(name_or_path, "pictures", detector)
    assert isinstance(net, PictureDetectorNet)
    return net


def load_points_and_pictures(
    name_or_path: str | Path = "points_and_pictures", detector: DetectorNet | None = None
) -> PointsAndPicturesNet:
    """Return the network of an agent with LiDARs and cameras; arguments and errors as of `load_pictures`."""
    net = _load_beside(name_or_path, "points_and_pictures", detector)
    assert isinstance(net, PointsAndPicturesNet)
    return net


def load_covariance(name_or_path: str | Path = "dmstrack", detector: DetectorNet | None = None) -> CovarianceNet:
    """Return the network of boxes' covariances, ready to be used; shared by all who ask, so not to be changed.

    Args:
        name_or_path: of the weights.
        detector: whose features it is to read, if it reads any; it must have the encoder that it was trained on.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, holds something else, or was trained on another encoder.
    """
    path = find_weights(name_or_path)
    texts = read_texts(path)
    _require_kind(path, texts, "covariance")
    net = _loaded_beside(path, digest(path))
    assert isinstance(net, CovarianceNet)
    if net.config.features:
        _require_encoder(path, texts, detector)
    return net


def load_point_identity(name_or_path: str | Path = "point_identity") -> PointIdentityNet:
    """Return the network of objects' identity by their points; to be shared, and errors, as of `load_covariance`."""
    net = _load_beside(name_or_path, "point_identity", None)
    assert isinstance(net, PointIdentityNet)
    return net


def load_picture_identity(name_or_path: str | Path = "picture_identity") -> PictureIdentityNet:
    """Return the network of objects' identity by their pictures; to be shared, and errors, as of `load_covariance`."""
    net = _load_beside(name_or_path, "picture_identity", None)
    assert isinstance(net, PictureIdentityNet)
    return net


def load_queries(name_or_path: str | Path, detector: DetectorNet, fusion: str | None = None) -> QueryNet:
    """Return a `QueryNet` with weights, ready to be used; shared by all who ask, so not to be changed.

    Args:
        name_or_path: of the weights.
        detector: whose features it will get; it must have the encoder that the weights were trained on.
        fusion: how agents are to cooperate; None: as the weights have it.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, was trained on another encoder, or for another fusion.
    """
    net = _load_beside(name_or_path, "queries", detector)
    assert isinstance(net, QueryNet)
    if fusion is not None and net.config.fusion != fusion:
        raise InvalidValueError(
            f"{find_weights(name_or_path)}: must be weights of the fusion {fusion!r}, is {net.config.fusion!r}"
        )
    return net


def load_integrated(name_or_path: str | Path, detector: DetectorNet) -> IntegratedNet:
    """Return an `IntegratedNet` with weights, ready to be used; shared by all who ask, so not to be changed.

    Args:
        name_or_path: of the weights.
        detector: whose features it will get; it must have the encoder that the weights were trained on.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, holds something else, or was trained on another encoder.
    """
    net = _load_beside(name_or_path, "integrated", detector)
    assert isinstance(net, IntegratedNet)
    return net


def save_weights(path: Path, net: nn.Module, metadata: Mapping[str, Any]) -> None:
    """Write a network's weights as 16 bit floats.

    Args:
        path: of the file.
        net: the network.
        metadata: plain data; `kind`, see `network_of`, and `config`, from which the network is made again, must be
            there. Classes and coopsim's version are added.

    Raises:
        InvalidValueError: the weights are not finite, or too large for 16 bits, or the file cannot be written.
    """
    tensors = {name: _small(value) for name, value in net.state_dict().items()}
    for name, tensor in tensors.items():
        if not bool(torch.isfinite(tensor).all()):
            raise InvalidValueError(f"{name} must be finite and fit into 16 bits, and does not")
    said = {"classes": list(CLASS_NAMES), "version": coopsim.__version__, **metadata}
    texts = {key: value if isinstance(value, str) else _json(value) for key, value in said.items()}
    write_tensors(path, tensors, texts)


def read_texts(name_or_path: str | Path) -> dict[str, str]:
    """Return what a file says of its weights, by key; all but names are JSON."""
    return read_header(find_weights(name_or_path))[1]


def read_config(name_or_path: str | Path) -> dict[str, Any]:
    """Return the options from which the network of a file is made."""
    found = _said(find_weights(name_or_path), read_texts(name_or_path), "config")
    return found if isinstance(found, dict) else {}


def card(name_or_path: str | Path) -> dict[str, Any]:
    """Return the card of weights: how they were made, and what was measured with them; empty if there is none."""
    path = find_weights(name_or_path).with_suffix(".json")
    if not path.exists():
        return {}
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise InvalidValueError(f"{path}: is no card of weights") from error


def digest(name_or_path: str | Path) -> str:
    """Return 64 hexadecimal digits that differ for any other weights or network."""
    path = find_weights(name_or_path)
    read_header(path)  # refuses what is missing, too large or something else
    state = path.stat()
    return _digest_of_file(path, state.st_mtime_ns, state.st_size)


def encoder_digest(detector: DetectorNet) -> str:
    """Return 64 hexadecimal digits that differ for any other encoder, as it is in a file."""
    found = hashlib.sha256(_json(asdict(detector.config)).encode())
    for name, value in sorted(detector.encoder.state_dict().items()):
        found.update(f"\0{name}\0{tuple(value.shape)}\0".encode())
        found.update(np.ascontiguousarray(_small(value).cpu().numpy()).tobytes())
    return found.hexdigest()


def network_of(path: Path, texts: Mapping[str, str]) -> nn.Module:
    """Return a network as a file describes it, with weights of no meaning.

    Raises:
        InvalidValueError: the description is broken, or for other classes.
    """
    config, classes = (_said(path, texts, key) for key in ("config", "classes"))
    if classes != list(CLASS_NAMES):
        other = sorted(set(CLASS_NAMES).symmetric_difference(map(str, classes if isinstance(classes, list) else ())))
        raise InvalidValueError(f"{path}: the weights are for other classes; not in both: {', '.join(other)}")
    made = {
        "detector": make_detector,
        "pictures": make_pictures,
        "points_and_pictures": make_points_and_pictures,
        "covariance": make_covariance,
        "point_identity": make_point_identity,
        "picture_identity": make_picture_identity,
        "queries": make_queries,
        "integrated": make_integrated,
    }
    kind = texts.get("kind", "cooperative")
    return made[kind](config) if kind in made else make_cooperative(config)[0]


def make_detector(config: Mapping[str, Any], seed: int = 0) -> DetectorNet:
    """Return a network of one agent with random weights, the same for the same seed."""
    return _made(EncoderConfig, DetectorNet, config, seed)


def make_pictures(config: Mapping[str, Any], seed: int = 0) -> PictureDetectorNet:
    """Return a network of an agent with cameras, with random weights, the same for the same seed."""
    return _made(LiftSplatConfig, PictureDetectorNet, config, seed)


def make_points_and_pictures(config: Mapping[str, Any], seed: int = 0) -> PointsAndPicturesNet:
    """Return a network of an agent with LiDARs and cameras, with random weights, the same for the same seed."""
    return _made(PointsAndPicturesConfig, PointsAndPicturesNet, config, seed)


def make_covariance(config: Mapping[str, Any], seed: int = 0) -> CovarianceNet:
    """Return a network of boxes' covariances with random weights, the same for the same seed."""
    return _made(CovarianceConfig, CovarianceNet, config, seed)


def make_point_identity(config: Mapping[str, Any], seed: int = 0) -> PointIdentityNet:
    """Return a network of objects' identity by their points, with random weights, the same for the same seed."""
    return _made(PointIdentityConfig, PointIdentityNet, config, seed)


def make_picture_identity(config: Mapping[str, Any], seed: int = 0) -> PictureIdentityNet:
    """Return a network of objects' identity by their pictures, with random weights, the same for the same seed."""
    return _made(PictureIdentityConfig, PictureIdentityNet, config, seed)


def make_queries(config: Mapping[str, Any], seed: int = 0) -> QueryNet:
    """Return a network of instance queries with random weights, the same for the same seed."""
    return _made(QueryConfig, QueryNet, config, seed)


def make_integrated(config: Mapping[str, Any], seed: int = 0) -> IntegratedNet:
    """Return a network of integrated detection and tracking with random weights, the same for the same seed."""
    return _made(IntegratedConfig, IntegratedNet, config, seed)


def make_cooperative(config: Mapping[str, Any], seed: int = 0) -> tuple[CooperativeNet, CooperativeConfig]:
    """Return a network of several agents with random weights, the same for the same seed, and its checked options."""
    checked: CooperativeConfig = load(CooperativeConfig, config, "network")
    with _seeded(seed):
        return CooperativeNet.from_config(checked), checked


def _made(kind: type[Any], network: Callable[[Any], N], config: Mapping[str, Any], seed: int) -> N:
    """Return a network of a config's checked options, with random weights of a seed."""
    checked = load(kind, config, "network")
    with _seeded(seed):
        return network(checked)


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """Let modules draw their first weights from a seed; afterwards torch's global generator is as before."""
    with torch.random.fork_rng(devices=[]):
        torch.random.manual_seed(seed)
        yield


@lru_cache(_LOADED)
def _loaded_detector(path: Path, _digest: str) -> DetectorNet:
    _require_kind(path, read_texts(path), "detector")
    net = _loaded(path)
    assert isinstance(net, DetectorNet)
    return net


def _load_beside(name_or_path: str | Path, kind: str, detector: DetectorNet | None) -> nn.Module:
    path = find_weights(name_or_path)
    texts = read_texts(path)
    _require_kind(path, texts, kind)
    _require_encoder(path, texts, detector)
    return _loaded_beside(path, digest(path))


@lru_cache(_LOADED)
def _loaded_beside(path: Path, _digest: str) -> nn.Module:
    return _loaded(path)


@lru_cache(_LOADED)
def _loaded_cooperative(path: Path, _digest: str) -> CooperativeNet:
    net = _loaded(path)
    assert isinstance(net, CooperativeNet)
    return net


def _loaded(path: Path) -> nn.Module:
    texts = read_texts(path)
    with torch.device("meta"):  # takes no memory: a small file may describe a huge network
        wanted = network_of(path, texts).state_dict()
    tensors = read_tensors(path, wanted)
    net = network_of(path, texts)
    net.load_state_dict(tensors)
    return net.eval().requires_grad_(False)


def _said(path: Path, texts: Mapping[str, str], key: str) -> Any:
    try:
        return json.loads(texts[key])
    except (KeyError, ValueError, RecursionError) as error:
        raise InvalidValueError(f"{path}: does not say which network its weights are for") from error


def _require_encoder(path: Path, texts: Mapping[str, str], detector: DetectorNet | None) -> None:
    if detector is not None and texts.get("encoder_digest") != encoder_digest(detector):
        raise InvalidValueError(
            f"{path}: was trained on another encoder (digest {texts.get('encoder_digest', '?')[:8]}, not "
            f"{encoder_digest(detector)[:8]}): take that one, {texts.get('detector', '?')!r}, or train anew"
        )


def _require_kind(path: Path, texts: Mapping[str, str], kind: str) -> None:
    if texts.get("kind") != kind:
        raise InvalidValueError(f"{path}: must be weights of the kind {kind!r}, is {texts.get('kind')!r}")


@lru_cache(64)
def _digest_of_file(path: Path, _modified_ns: int, _size: int) -> str:
    texts = read_texts(path)
    found = hashlib.sha256(_json({key: texts.get(key) for key in _DECIDES}).encode())
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(length))
        header.pop("__metadata__", None)
        found.update(_json(header).encode())
        found.update(file.read())
    return found.hexdigest()


def _small(value: torch.Tensor) -> torch.Tensor:
    return value.detach().half() if value.is_floating_point() else value.detach()


def _json(value: Any) -> str:
    return json.dumps(plain(value), sort_keys=True)
