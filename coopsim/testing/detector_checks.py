"""The conformance check of a detector."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.detection.detector import Detector, DetectorBase
from coopsim.detection.oracle import OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.errors import CoopsimError
from coopsim.support.rng import stream
from coopsim.testing.sensor_frames import SensorFrames, digest, sensor_frames
from coopsim.types import Detections
from coopsim.types.taxonomy import require_classes

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
        **options: of the environment whose sensors it is given, as `lidar="HDL-32E"` or `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no detector of that name is registered.
    """
    made, name = _make(detector), _name(detector)
    assert isinstance(made, (Detector, OracleDetector)), f"{name} must be a Detector or an OracleDetector, got {made!r}"
    dim = made.embedding_dim
    assert isinstance(dim, int) and dim >= 0, f"{name}: embedding_dim must be an integer >= 0, got {dim!r}"
    frames = sensor_frames(made.needs, _FRAMES, 3, options)
    first = _play(made, name, frames, seed=1)
    _play(made, name, frames.without_content(), seed=2)
    _require_same(first, _play(made, name, frames, seed=1), f"{name} must give the same again in a later episode")
    fresh = made if isinstance(detector, DetectorBase) else _make(detector)
    _require_same(first, _play(fresh, name, frames, seed=1), f"{name} must give the same with the same seed")
    backwards = _play(made, name, frames, seed=1, agents=list(frames.specs)[::-1])
    _require_same(first, backwards, f"{name} must not depend on the order of the agents", _TOLERANCE)


def _make(detector: str | DetectorBase | Callable[[], DetectorBase]) -> DetectorBase:
    if isinstance(detector, str):
        return make_detector(detector)
    return detector if isinstance(detector, DetectorBase) else detector()


def _name(detector: object) -> str:
    return detector if isinstance(detector, str) else getattr(detector, "__name__", type(detector).__name__)


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
        before = digest(views)
        found: Mapping[str, Detections]
        if isinstance(begun, OracleDetector):
            found = {agent: begun.detect(view, frames.oracles[k][agent], rngs[agent]) for agent, view in views.items()}
        else:
            found = begun.detect_all(views, rngs)
            assert set(found) == set(views), f"{name}: detect_all must return the agents {order}, got {sorted(found)}"
        assert digest(views) == before, f"{name} must leave its view as it is"
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


def _require_same(first: Episode, again: Episode, rule: str, tolerance: float = 0.0) -> None:
    for k, (one, two) in enumerate(zip(first, again, strict=True)):
        for agent, found in one.items():
            for column in ("boxes", "score", "label", "embedding", "covariance"):
                a, b = (getattr(each[agent], column) for each in (one, two))
                a, b = (each.array if column == "boxes" else each for each in (a, b))
                same = (a is None) == (b is None) and (
                    a is None
                    or (a.shape == b.shape and np.allclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True))
                )
                assert same, f"{rule}: {column} of {agent} differ in frame {k} ({len(found)} detections)"
