"""Match detections with objects and measure their errors, alike for recordings and for the simulation.

Positions are in the axes of the detecting car (x forward, y left, z up). An object is found if a detection's center
is within `GATE_M` of its center over ground (Hungarian on the distance); unmatched detections are false.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np

import coopsim
from coopsim.data.recording_set import RecordingSet
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.types import AgentSpec, Detections, Ints, Mask, SensorView, Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.world.snapshot import Actors

AGENTS = ("ego", "1")
"""Names of the recordings' single-car detections; the first car owns the frame."""

GATE_M = 3.0
OWN_M = 2.5
"""Labels with a center nearer than this are the detecting car itself, as labelled for the other car."""

SENSOR_M = 1.9
"""Assumed height of the recordings' LiDAR over a flat road."""


Note: TypeAlias = tuple[Ints, Actors, Detections]
"""Returns per actor around an agent, the actors, and the agent's detections."""


@dataclass
class Matches:
    """Rows of objects and of false detections; columns by name, (N,) each, once `close` has been called.

    Objects: episode, frame, object, x, y, returns, found, score, turned, and the errors along, across, up, length,
    width, height, yaw (NaN where not found). False ones: episode, frame, x, y, z, length, width, height, yaw, score.
    """

    objects: dict[str, Floats] = field(default_factory=dict)
    false: dict[str, Floats] = field(default_factory=dict)
    frames: int = 0
    _objects: list[dict[str, Floats]] = field(default_factory=list)
    _false: list[dict[str, Floats]] = field(default_factory=list)

    def add(self, episode: int, frame: int, ids: Ints, truth: Boxes3D, returns: Ints, found: Detections) -> None:
        """Add one frame of one car; boxes in its axes."""
        distance = np.linalg.norm(found.boxes.center[:, None, :2] - truth.center[None, :, :2], axis=2)
        mine, theirs = hungarian(-distance, -GATE_M)
        of = np.full(len(ids), -1)
        of[theirs] = mine
        self.frames += 1
        self._objects.append(
            {
                "episode": np.full(len(ids), episode),
                "frame": np.full(len(ids), frame),
                "object": ids,
                "x": truth.center[:, 0],
                "y": truth.center[:, 1],
                "returns": returns,
                "found": of >= 0,
                "score": np.append(found.score, np.nan)[of],
                **_errors(truth, found.boxes, of),
            }
        )
        wrong = np.setdiff1d(np.arange(len(found)), mine)
        columns = zip(("x", "y", "z", "length", "width", "height", "yaw"), found.boxes.array[wrong].T, strict=True)
        self._false.append(
            {
                "episode": np.full(len(wrong), episode),
                "frame": np.full(len(wrong), frame),
                "score": found.score[wrong],
                **dict(columns),
            }
        )

    def close(self) -> Matches:
        """Join all frames."""
        self.objects, self.false = (
            {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
            for rows in (self._objects, self._false)
        )
        for table in (self.objects, self.false):
            table["range"] = np.hypot(table["x"], table["y"])
        return self

    def within(self, reach_m: Sequence[float], least_returns: int = 1) -> Mask:
        """Return the mask of objects within reach that have enough returns."""
        inside = (np.abs(self.objects["x"]) <= reach_m[0]) & (np.abs(self.objects["y"]) <= reach_m[1])
        mask: Mask = inside & (self.objects["returns"] >= least_returns)
        return mask


def read_matches(folder: Path, without: Sequence[str]) -> dict[str, Matches]:
    """Match recorded detections by car: of the car that owns the frame, and of the other, with unknown position.

    The recordings have no points. Returns are those that the simulator expects of an HDL-32E in the first car, with the
    labelled boxes occluding each other on a flat road; the other car's objects have the same returns.
    """
    lidar = LidarConfig()
    sight = ReturnsEstimator([], lidar.beams, lidar.columns, lidar.max_range_m)
    origin = np.array([0.0, 0.0, SENSOR_M])
    recordings, matches = RecordingSet(folder), {name: Matches() for name in AGENTS}
    for episode, sequence in enumerate(each for each in recordings.sequences if each not in without):
        recording = recordings.load(sequence, AGENTS)
        for frame, truth in enumerate(recording.truth):
            boxes = in_car_axes(truth.boxes)
            other = np.linalg.norm(boxes.center[:, :2], axis=1) > OWN_M
            boxes, ids = boxes[other], truth.id[other]
            returns = sight.expected_returns(origin[None], _standing(boxes), [None])[0]
            for name, detections in recording.detections.items():
                found = detections[frame]
                found = Detections(in_car_axes(found.boxes), found.score, found.label)
                matches[name].add(episode, frame, ids, boxes, returns, found)
    return {name: each.close() for name, each in matches.items()}


class Watch(OracleDetector):
    """A wrapper of a simulated detector that records the truth it receives and its detections, by agent and frame.

    Args:
        inner: the wrapped detector.
    """

    def __init__(self, inner: OracleDetector) -> None:
        self.inner = inner
        self.notes: dict[str, list[Note]] = {}

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        """Begin another episode; return a wrapper with new notes."""
        begun = type(self)(self.inner.begin(specs, seed))
        begun.notes = self.notes = {agent: [] for agent in specs}
        return begun

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Detect as the inner detector does."""
        found = self.inner.detect(view, oracle, rng)
        self.notes[view.agent].append((oracle.returns, oracle.actors, found))
        return found


def simulate_matches(detector: str, environments: Sequence[str], seeds: Sequence[int], **options: Any) -> Matches:
    """Match simulated detections of all agents, in episodes without LiDARs.

    Objects are those with an expected return for any agent, as labels are of objects that annotators saw in any car's
    points.
    """
    matches, episode = Matches(), 0
    for environment in environments:
        inner = make_detector(detector)
        assert isinstance(inner, OracleDetector)
        watch = Watch(inner)
        env = coopsim.parallel_env(environment, detector=watch, lidar=None, uplink="none", **options)
        for seed in seeds:
            env.reset(seed=seed)
            idle = {name: {"tracks": pack_tracks(Tracks.empty())} for name in env.agents}
            while env.agents:
                env.step(idle)
            for k, seen in enumerate(zip(*watch.notes.values(), strict=True)):
                visible = np.concatenate([truth.id[returns > 0] for returns, truth, _ in seen])
                for agent, (returns, truth, found) in enumerate(seen):
                    kept = np.isin(truth.id, visible)
                    boxes = truth.boxes[kept]
                    matches.add(episode + agent, k, truth.id[kept], boxes, returns[kept], found)
            episode += len(idle)
        env.close()
    return matches.close()


def in_car_axes(boxes: Boxes3D) -> Boxes3D:
    """Convert V2V4Real's boxes to the axes of its LiDAR (x forward, y left, z up).

    Its files have KITTI's columns, but the LiDAR's x, y, z stand in the columns x, z, y, and the heading about z in
    rot_y. `coopsim.data.kitti` takes them for camera axes: that turns the ground by a quarter and mirrors height and
    heading.
    """
    center = np.column_stack([-boxes.center[:, 1], boxes.center[:, 0], boxes.size[:, 2] / 2 - boxes.center[:, 2]])
    return Boxes3D(center, boxes.size, wrap_angle(-boxes.yaw - np.pi / 2))


def _standing(boxes: Boxes3D) -> Actors:
    """Make actors of boxes on a flat road."""
    center = np.column_stack([boxes.center[:, :2], boxes.size[:, 2] / 2])
    count = len(boxes)
    zeros = np.zeros(count, dtype=np.int64)
    colors = np.zeros((count, 3), dtype=np.uint8)
    placed = Boxes3D(center, boxes.size, boxes.yaw)
    return Actors(np.arange(1, count + 1), placed, np.zeros((count, 2)), zeros, zeros, colors)


def _errors(truth: Boxes3D, found: Boxes3D, of: Ints) -> dict[str, Floats]:
    """Return the errors of box `of` (N,) for each object, NaN where it is -1; and its reported heading as `turned`."""
    rows = np.concatenate([found.array, np.full((1, 7), np.nan)])[of]
    shift = rows[:, :3] - truth.center
    cos, sin = np.cos(truth.yaw), np.sin(truth.yaw)
    grown = np.log(rows[:, 3:6] / truth.size)
    turn = (
        rows[:, 6] - truth.yaw + np.pi / 2
    ) % np.pi - np.pi / 2  # modulo a half turn: front and back are not distinguished
    return {
        "along": cos * shift[:, 0] + sin * shift[:, 1],
        "across": cos * shift[:, 1] - sin * shift[:, 0],
        "up": shift[:, 2],
        "length": grown[:, 0],
        "width": grown[:, 1],
        "height": grown[:, 2],
        "yaw": turn,
        "turned": rows[:, 6],
        "heading": truth.yaw,
    }
