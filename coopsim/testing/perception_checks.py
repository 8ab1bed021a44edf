"""The conformance checks of a detector and of an embedder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from coopsim.detection.detector import Detector, DetectorBase
from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.detection.oracle import OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.support.rng import stream
from coopsim.testing.harness import SensorFrames, name_of, require_same, sensor_frames, untouched
from coopsim.types import Detections, SensorView
from coopsim.types.taxonomy import require_classes
from coopsim.types.valid_detections import normalize_embeddings

_FRAMES = 3
_TOLERANCE = 1e-3  # of a batch in another order

Episode = list[Mapping[str, Detections]]


def check_detector(detector: str | DetectorBase | Callable[[], DetectorBase], **options: Any) -> None:
    """Check that a detector keeps what environments rely on.

    In each frame it must return `Detections` for every agent, with finite boxes of positive size, finite scores, known
    classes, and embeddings and covariances as announced; an empty world included. It must leave its view as it is. The
    same seed must give the same bits, whatever episodes were before, and the order of the agents must not matter.

    Args:
        detector: a registered name or spec, an object, or a class or function that makes one.
        **options: options of the environment that gives the sensor data, as `lidar="HDL-32E"` or `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no detector of that name is registered.
    """
    made, name = _make(detector), name_of(detector)
    assert isinstance(made, (Detector, OracleDetector)), f"{name} must be a Detector or an OracleDetector, got {made!r}"
    dim = made.embedding_dim
    assert isinstance(dim, int) and dim >= 0, f"{name}: embedding_dim must be an integer >= 0, got {dim!r}"
    frames = sensor_frames(made.needs, _FRAMES, 3, options)
    first = _play(made, name, frames, seed=1)
    _play(made, name, frames.without_content(), seed=2)
    require_same(
        first, _play(made, name, frames, seed=1), f"{name} must give the same again in a later episode", _differs
    )
    fresh = made if isinstance(detector, DetectorBase) else _make(detector)
    require_same(first, _play(fresh, name, frames, seed=1), f"{name} must give the same with the same seed", _differs)
    backwards = _play(made, name, frames, seed=1, agents=list(frames.specs)[::-1])
    nearly = partial(_differs, tolerance=_TOLERANCE)
    require_same(first, backwards, f"{name} must not depend on the order of the agents", nearly)


def _make(detector: str | DetectorBase | Callable[[], DetectorBase]) -> DetectorBase:
    if isinstance(detector, str):
        return make_detector(detector)
    return detector if isinstance(detector, DetectorBase) else detector()


def _play(
    detector: DetectorBase, name: str, frames: SensorFrames, seed: int, agents: Sequence[str] | None = None
) -> Episode:
    """Run one episode, and check what each frame gives."""
    order = list(frames.specs) if agents is None else agents
    begun = detector.begin({agent: frames.specs[agent] for agent in order}, seed)
    assert isinstance(begun, (Detector, OracleDetector)), f"{name}: begin must return a detector, got {begun!r}"
    rngs = {agent: stream(seed, "detector", agent) for agent in order}
    episode: Episode = []
    for k in range(len(frames.views)):
        views = {agent: frames.views[k][agent] for agent in order}
        found: Mapping[str, Detections]
        with untouched(views, f"{name} must leave its view as it is"):
            if isinstance(begun, OracleDetector):
                oracles = frames.oracles[k]
                found = {agent: begun.detect(view, oracles[agent], rngs[agent]) for agent, view in views.items()}
            else:
                found = begun.detect_all(views, rngs)
        assert set(found) == set(views), f"{name}: detect_all must return the agents {order}, got {sorted(found)}"
        for detections in found.values():
            _require_valid(detections, name, detector)
        episode.append(found)
    return episode


def _require_valid(detections: object, name: str, detector: DetectorBase) -> None:
    assert isinstance(detections, Detections), f"{name} must return Detections, got {type(detections).__name__}"
    try:
        if len(detections):
            detections.boxes.validate("boxes")
        require_classes(detections.label, "detection")
    except CoopsimError as error:
        raise AssertionError(f"{name}: {error}") from error
    assert np.isfinite(detections.score).all(), f"{name}: scores must be finite, got {detections.score}"
    if detections.embedding is not None:
        width = detections.embedding.shape[1]
        assert width == detector.embedding_dim, (
            f"{name}: embeddings must have the length embedding_dim = {detector.embedding_dim}, got {width}"
        )
    if detections.covariance is not None:
        assert detector.states_covariance, f"{name}: detections with covariances need states_covariance = True"
        assert np.isfinite(detections.covariance).all(), f"{name}: covariances must be finite"
        symmetric = np.allclose(detections.covariance, detections.covariance.transpose(0, 2, 1))
        assert symmetric, f"{name}: covariances must be symmetric"
        least = np.linalg.eigvalsh(detections.covariance).min(initial=0.0)
        assert least > -1e-9, f"{name}: covariances must have no negative eigenvalue, got {least:g}"


def _differs(one: Detections, two: Detections, tolerance: float = 0.0) -> str:
    for column in ("boxes", "score", "label", "embedding", "covariance"):
        a, b = (getattr(each, column) for each in (one, two))
        a, b = (each.array if column == "boxes" else each for each in (a, b))
        if (a is None) != (b is None):
            return column
        if a is not None and not (
            a.shape == b.shape and np.allclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True)
        ):
            return column
    return ""


def check_embedder(embedder: str | Embedder | Callable[[], Embedder], **options: Any) -> None:
    """Check that an embedder keeps what environments rely on.

    It must return (N, `dim`) numbers for N detections, none included; give some detection an appearance; give the same
    again; give each detection its own row, in whatever order they are; and leave detections and view as they are.

    Args:
        embedder: a registered name or spec, an object, or a class or function that makes one.
        **options: options of the environment that gives the sensor data, as `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no embedder of that name is registered.
    """
    name = name_of(embedder)
    if isinstance(embedder, str):
        made = make_embedder(embedder)
    else:
        made = embedder if isinstance(embedder, Embedder) else embedder()
    assert isinstance(made, Embedder), f"{name} must be an Embedder, got {made!r}"
    dim = getattr(made, "dim", None)
    assert isinstance(dim, int) and dim > 0, f"{name}: dim must be an integer > 0, got {dim!r}"
    frames = sensor_frames(made.needs, 2, 3, options)
    known = 0
    for views, detections in zip(frames.views, frames.detections, strict=True):
        for agent, view in views.items():
            found = detections[agent]
            rows = _embed(made, name, found, view)
            same = np.array_equal(rows, _embed(made, name, found, view), equal_nan=True)
            assert same, f"{name} must give the same embeddings again"
            turned = _embed(made, name, found[::-1], view)[::-1]
            alike = np.allclose(rows, turned, rtol=_TOLERANCE, atol=_TOLERANCE, equal_nan=True)
            assert alike, f"{name} must not depend on the order of the detections"
            known += int(normalize_embeddings(rows)[1].sum())
    assert known, f"{name} must embed some of the detections, but all rows are zeros or not finite"
    empty = frames.without_content()
    for agent, view in empty.views[0].items():
        _embed(made, name, Detections.empty(), view)
        _embed(made, name, frames.detections[0][agent], view)


def _embed(embedder: Embedder, name: str, detections: Detections, view: SensorView) -> np.ndarray[Any, Any]:
    detections = replace(detections, embedding=None)
    inputs = {"view": view, "detections": detections}
    with untouched(inputs, f"{name} must leave its detections and its view as they are"):
        try:
            embedded = embedder.apply(detections, view)
        except InvalidValueError as error:
            raise AssertionError(f"{name}: {error}") from error
    assert embedded.embedding is not None
    return embedded.embedding
