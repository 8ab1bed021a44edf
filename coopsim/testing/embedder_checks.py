"""The conformance check of an embedder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.errors import InvalidValueError
from coopsim.testing.sensor_frames import digest, sensor_frames
from coopsim.types import Detections, SensorView
from coopsim.types.embedding import normalize_embeddings

_FRAMES = 2
_TOLERANCE = 1e-3


def check_embedder(embedder: str | Embedder | Callable[[], Embedder], **options: Any) -> None:
    """Check that an embedder keeps what environments rely on.

    It must return (N, `dim`) numbers for N detections, none included; give some detection an appearance; give the same
    again; give each detection its own row, in whatever order they are; and leave detections and view as they are.

    Args:
        embedder: a registered name or spec, an object, or a class or function that makes one.
        **options: of the environment whose sensors it is given, as `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no embedder of that name is registered.
    """
    name = embedder if isinstance(embedder, str) else getattr(embedder, "__name__", type(embedder).__name__)
    if isinstance(embedder, str):
        made = make_embedder(embedder)
    else:
        made = embedder if isinstance(embedder, Embedder) else embedder()
    assert isinstance(made, Embedder), f"{name} must be an Embedder, got {made!r}"
    dim = getattr(made, "dim", None)
    assert isinstance(dim, int) and dim > 0, f"{name}: dim must be an integer > 0, got {dim!r}"
    frames = sensor_frames(made.needs, _FRAMES, 3, options)
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
    before = digest(inputs)
    try:
        embedded = embedder.apply(detections, view)
    except InvalidValueError as error:
        raise AssertionError(f"{name}: {error}") from error
    assert digest(inputs) == before, f"{name} must leave its detections and its view as they are"
    assert embedded.embedding is not None
    return embedded.embedding
