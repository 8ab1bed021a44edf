"""Real sensor data of a small environment, for the checks of detectors and embedders."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from coopsim.catalog import parallel_env
from coopsim.detection.detector import SensorNeeds
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.types import AgentSpec, CameraImage, Detections, SensorView, Sweep, Tracks
from coopsim.wire.actions import pack_tracks

_SMALL: dict[str, Any] = {"vehicles": 10, "lidar_columns": 256, "lidar": "VLP-16", "uplink": "none"}


@dataclass(frozen=True)
class SensorFrames:
    """The frames of one short episode.

    Attributes:
        specs: the agents, by name.
        views: each frame's sensor data, by agent.
        oracles: each frame's truth, by agent.
        detections: each frame's detections by `SimulatedDetector`, by agent.
    """

    specs: Mapping[str, AgentSpec]
    views: tuple[Mapping[str, SensorView], ...]
    oracles: tuple[Mapping[str, Oracle], ...]
    detections: tuple[Mapping[str, Detections], ...]

    def without_content(self) -> SensorFrames:
        """Return one frame in which nothing is around: no points, black images, no actors, no detections."""
        views = {name: _emptied(view) for name, view in self.views[0].items()}
        oracles = {
            name: replace(oracle, actors=oracle.actors[:0], returns=oracle.returns[:0])
            for name, oracle in self.oracles[0].items()
        }
        return SensorFrames(self.specs, (views,), (oracles,), (dict.fromkeys(views, Detections.empty()),))


class _Recorder(OracleDetector):
    """A simulated detector that records its inputs and outputs."""

    def __init__(self) -> None:
        self.specs: Mapping[str, AgentSpec] = {}
        self.notes: list[tuple[SensorView, Oracle, Detections]] = []

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> _Recorder:
        self.specs, self.notes = specs, []
        return self

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        detections = SimulatedDetector().detect(view, oracle, rng)
        self.notes.append((view, oracle, detections))
        return detections


def sensor_frames(needs: SensorNeeds, frames: int, seed: int, options: Mapping[str, Any]) -> SensorFrames:
    """Simulate a few frames with sensors.

    Args:
        needs: the sensors that there must be; a LiDAR is there anyway.
        frames: their number.
        seed: the episode's seed.
        options: of the environment; they override the small one's.
    """
    recorder = _Recorder()
    cameras = {"cameras": "front", "renderer": "raycast"} if needs.cameras else {}
    env = parallel_env("crossing", **{**_SMALL, **cameras, **options, "detector": recorder, "max_cycles": frames})
    env.reset(seed=seed)
    for _ in range(frames - 1):
        env.step({agent: {"tracks": pack_tracks(Tracks.empty())} for agent in env.agents})
    env.close()
    count = len(recorder.specs)
    notes = [recorder.notes[k : k + count] for k in range(0, len(recorder.notes), count)]
    return SensorFrames(
        recorder.specs,
        tuple({view.agent: view for view, _, _ in frame} for frame in notes),
        tuple({view.agent: oracle for view, oracle, _ in frame} for frame in notes),
        tuple({view.agent: found for view, _, found in frame} for frame in notes),
    )


def digest(value: object) -> str:
    """Return a digest of all arrays and numbers in nested dataclasses and mappings, to find out what changed."""
    return hashlib.sha256(b"\x00".join(_bytes(value))).hexdigest()


def _bytes(value: object) -> Iterator[bytes]:
    if is_dataclass(value):
        for field in fields(value):
            yield from _bytes(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield str(key).encode()
            yield from _bytes(each)
    elif isinstance(value, np.ndarray):
        yield str(value.shape).encode() + value.tobytes()
    else:
        yield repr(value).encode()


def _emptied(view: SensorView) -> SensorView:
    images = {
        name: CameraImage(
            None if image.rgb is None else np.zeros_like(image.rgb),
            None if image.depth is None else np.zeros_like(image.depth),
        )
        for name, image in view.images.items()
    }
    return replace(view, sweeps=dict.fromkeys(view.sweeps, Sweep.empty()), images=images)
