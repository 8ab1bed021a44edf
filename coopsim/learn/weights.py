"""Weights of networks in files: written small, found by name or path, and checked before they are used."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from coopsim.config.checked_entry import plain
from coopsim.config.load import load
from coopsim.errors import InvalidValueError, UnknownNameError, WeightsNotShippedError
from coopsim.learn.recipe import RECIPES
from coopsim.learn.tensor_file import read_header, read_tensors, write_tensors
from coopsim.nn.camera.lift_splat import LiftSplatConfig, PictureDetectorNet
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesConfig, PointsAndPicturesNet
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig, CooperativeNet
from coopsim.nn.covariance.covariance_net import CovarianceConfig, CovarianceNet
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.nn.identity.picture_identity_net import PictureIdentityConfig, PictureIdentityNet
from coopsim.nn.identity.point_encoder import PointIdentityConfig, PointIdentityNet
from coopsim.nn.integrated.integrated_net import IntegratedConfig, IntegratedNet
from coopsim.nn.queries.query_net import QueryConfig, QueryNet
from coopsim.nn.ranking_net import RankingConfig, RankingNet
from coopsim.support.precision import note_weights
from coopsim.support.user_code import code_in
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.version import __version__

SUFFIX = ".safetensors"

NETWORKS: Mapping[str, tuple[type[Any], Callable[[Any], nn.Module]]] = {
    "detector": (EncoderConfig, DetectorNet),
    "pictures": (LiftSplatConfig, PictureDetectorNet),
    "points_and_pictures": (PointsAndPicturesConfig, PointsAndPicturesNet),
    "cooperative": (CooperativeConfig, CooperativeNet.from_config),
    "covariance": (CovarianceConfig, CovarianceNet),
    "point_identity": (PointIdentityConfig, PointIdentityNet),
    "picture_identity": (PictureIdentityConfig, PictureIdentityNet),
    "queries": (QueryConfig, QueryNet),
    "integrated": (IntegratedConfig, IntegratedNet),
    "ranking": (RankingConfig, RankingNet),
}
"""Options and network of each kind of weights."""

_SHIPPED = Path(__file__).parents[1] / "weights"
_LOADED = 24
_LATER_OPTIONS = {"layout": "dense", "ground": "smooth", "bands_m": (), "apart": False}
"""Options of encoders that older files do not say, with what these have."""

_DECIDES = ("kind", "config", "classes", "encoder_digest")
"""Texts of a file that are part of its digest."""


def shipped_weights() -> tuple[str, ...]:
    """Return the names of the shipped weights."""
    return tuple(sorted(path.stem for path in _SHIPPED.glob(f"*{SUFFIX}")))


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of shipped weights, by name, or of others, by path.

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


def make_network(kind: str, config: Mapping[str, Any], seed: int = 0) -> Any:
    """Return a network of one of `NETWORKS` with random weights, the same for the same seed.

    Torch's global generator is afterwards as before.

    Raises:
        InvalidValueError, UnknownNameError: an option is not accepted.
    """
    options, network = NETWORKS[kind]
    checked = load(options, config, "network")
    with torch.random.fork_rng(devices=[]):
        torch.random.manual_seed(seed)
        return network(checked)


def load_network(
    kind: str, name_or_path: str | Path, detector: DetectorNet | None = None, fusion: str | None = None
) -> Any:
    """Return a network with weights, in evaluation mode. All callers share it: it must not be changed.

    Args:
        kind: one of `NETWORKS`.
        name_or_path: name of shipped weights, or path of a file.
        detector: detector whose features the network reads; it must have the encoder of the training.
        fusion: fusion of the weights as the user names it, if that is code, such as "mine.py:MyFusion": no file of
            weights runs code that the user has not named. None: a registered one.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the file is broken, too large, of another kind, or was trained on another encoder.
    """
    path = find_weights(name_or_path)
    texts = read_texts(path)
    if texts.get("kind") != kind:
        raise InvalidValueError(f"{path}: must be weights of the kind {kind!r}, is {texts.get('kind')!r}")
    net = _loaded(path, digest(path), _named_fusion(path, texts, fusion))
    reads_features = kind != "covariance" or net.config.features
    if detector is not None and reads_features and texts.get("encoder_digest") != encoder_digest(detector):
        raise InvalidValueError(
            f"{path}: was trained on another encoder (digest {texts.get('encoder_digest', '?')[:8]}, not "
            f"{encoder_digest(detector)[:8]}): take that one, {texts.get('detector', '?')!r}, or train anew"
        )
    return net


def load_detector_of(name_or_path: str | Path, named: str | None = None) -> DetectorNet:
    """Return the detector on whose encoder the network of a file was trained: beside it, or shipped.

    Args:
        name_or_path: name or path of the network's weights.
        named: name or path of the detector's weights, which then count, not the file's own name for them.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: a file is broken or too large, or the detector's weights are not found.
    """
    if named is not None:
        return load_detector(named)
    path = find_weights(name_or_path)
    found = read_texts(path).get("detector", "pillars")
    beside = path.with_name(Path(found).name.removesuffix(SUFFIX) + SUFFIX)
    for each in () if path.parent == _SHIPPED else (beside, Path(found)):
        if each.suffix == SUFFIX and each.exists():
            return load_detector(each)
    if found not in shipped_weights():
        raise InvalidValueError(
            f"{path}: was trained on {found!r}, which is neither beside it nor shipped; name it: detector_weights=PATH"
        )
    return load_detector(found)


def load_detector(name_or_path: str | Path = "pillars") -> DetectorNet:
    """Return the network of one agent with LiDARs; see `load_network`."""
    return cast(DetectorNet, load_network("detector", name_or_path))


def load_cooperative(
    name_or_path: str | Path, detector: DetectorNet | None = None, fusion: str | None = None
) -> CooperativeNet:
    """Return the network of cooperating agents; see `load_network`."""
    return cast(CooperativeNet, load_network("cooperative", name_or_path, detector, fusion))


def load_pictures(name_or_path: str | Path = "lift_splat", detector: DetectorNet | None = None) -> PictureDetectorNet:
    """Return the network of an agent with cameras; see `load_network`."""
    return cast(PictureDetectorNet, load_network("pictures", name_or_path, detector))


def load_points_and_pictures(
    name_or_path: str | Path = "points_and_pictures", detector: DetectorNet | None = None
) -> PointsAndPicturesNet:
    """Return the network of an agent with LiDARs and cameras; see `load_network`."""
    return cast(PointsAndPicturesNet, load_network("points_and_pictures", name_or_path, detector))


def load_covariance(name_or_path: str | Path = "dmstrack", detector: DetectorNet | None = None) -> CovarianceNet:
    """Return the network of boxes' covariances; see `load_network`. A network without features takes any detector."""
    return cast(CovarianceNet, load_network("covariance", name_or_path, detector))


def load_point_identity(name_or_path: str | Path = "point_identity") -> PointIdentityNet:
    """Return the network of objects' identity by their points; see `load_network`."""
    return cast(PointIdentityNet, load_network("point_identity", name_or_path))


def load_picture_identity(name_or_path: str | Path = "picture_identity") -> PictureIdentityNet:
    """Return the network of objects' identity by their images; see `load_network`."""
    return cast(PictureIdentityNet, load_network("picture_identity", name_or_path))


def load_queries(name_or_path: str | Path, detector: DetectorNet, fusion: str | None = None) -> QueryNet:
    """Return the network of instance queries; see `load_network`.

    Args:
        name_or_path: see `load_network`.
        detector: see `load_network`.
        fusion: name of the fusion that the weights must be for; None: any.
    """
    net: QueryNet = load_network("queries", name_or_path, detector)
    if fusion is not None and net.config.fusion != fusion:
        raise InvalidValueError(
            f"{find_weights(name_or_path)}: must be weights of the fusion {fusion!r}, is {net.config.fusion!r}"
        )
    return net


def load_integrated(name_or_path: str | Path, detector: DetectorNet) -> IntegratedNet:
    """Return the network of integrated detection and tracking; see `load_network`."""
    return cast(IntegratedNet, load_network("integrated", name_or_path, detector))


def load_ranking(name_or_path: str | Path) -> RankingNet:
    """Return the network that ranks an agent's detections; see `load_network`."""
    return cast(RankingNet, load_network("ranking", name_or_path))


def save_weights(path: Path, net: nn.Module, metadata: Mapping[str, Any]) -> None:
    """Write a network's weights as 16 bit floats.

    Args:
        path: file to write.
        net: the network.
        metadata: plain data with at least `kind`, one of `NETWORKS`, and `config`, the network's options. Classes and
            coopsim's version are added.

    Raises:
        InvalidValueError: the weights are not finite, or too large for 16 bits, or the file cannot be written.
    """
    tensors = {name: _small(value) for name, value in net.state_dict().items()}
    for name, tensor in tensors.items():
        if not bool(torch.isfinite(tensor).all()):
            raise InvalidValueError(f"{name} must be finite and fit into 16 bits, and does not")
    said = {"classes": list(CLASS_NAMES), "version": __version__, **metadata}
    texts = {key: value if isinstance(value, str) else _json(value) for key, value in said.items()}
    write_tensors(path, tensors, texts)


def read_texts(name_or_path: str | Path) -> dict[str, str]:
    """Return a file's metadata by key; all values but names are JSON."""
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
    config = asdict(detector.config)
    for name, usual in _LATER_OPTIONS.items():
        if config[name] == usual:
            del config[name]
    if config["head"] == "turned":
        config["head"] = "centre"  # the second look was added later to heads on the same encoders
    found = hashlib.sha256(_json(config).encode())
    for name, value in sorted(detector.encoder.state_dict().items()):
        found.update(f"\0{name}\0{tuple(value.shape)}\0".encode())
        found.update(np.ascontiguousarray(_small(value).cpu().numpy()).tobytes())
    return found.hexdigest()


def _named_fusion(path: Path, texts: Mapping[str, str], fusion: str | None) -> str | None:
    """Return the place of the fusion of weights as the user names it; None where it is a registered one.

    Raises:
        InvalidValueError: the file names code and the user does not, or the user names another class.
    """
    config = _said(path, texts, "config")
    code = code_in(config)
    if code is None and fusion is None:
        return None
    stored = config.get("fusion") if isinstance(config, dict) else None
    if code not in (None, stored):
        raise InvalidValueError(f"{path}: must not name code but as its fusion, got {code!r}")
    if code is None or (fusion is not None and str(stored).rpartition(":")[2] != fusion.rpartition(":")[2]):
        raise InvalidValueError(f"{path}: fusion must be that of the training, {stored!r}, got {fusion!r}")
    if fusion is None:
        raise InvalidValueError(
            f"{path}: its fusion is code, {stored!r}, which runs only if you name it: fusion={stored!r} beside weights "
            "of a policy, network.fusion of a training"
        )
    return fusion


@lru_cache(_LOADED)
def _loaded(path: Path, _digest: str, fusion: str | None = None) -> Any:
    texts = read_texts(path)
    config, classes = (_said(path, texts, key) for key in ("config", "classes"))
    if fusion is not None:
        config = {**config, "fusion": fusion}
    if classes != list(CLASS_NAMES):
        other = sorted(set(CLASS_NAMES).symmetric_difference(map(str, classes if isinstance(classes, list) else ())))
        raise InvalidValueError(f"{path}: the weights are for other classes; not in both: {', '.join(other)}")
    tensors = None
    if path.parent != _SHIPPED:  # a stranger's small file may describe a huge network
        # Shapes alone take no memory, but a second, and memory, to import the compiler of torch, which computes them.
        with torch.device("meta"):
            wanted = make_network(texts["kind"], config).state_dict()
        tensors = read_tensors(path, wanted)
    net = make_network(texts["kind"], config)
    net.load_state_dict(read_tensors(path, net.state_dict()) if tensors is None else tensors)
    return net.eval().requires_grad_(False)


def _said(path: Path, texts: Mapping[str, str], key: str) -> Any:
    try:
        return json.loads(texts[key])
    except (KeyError, ValueError, RecursionError) as error:
        raise InvalidValueError(f"{path}: does not say which network its weights are for") from error


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
