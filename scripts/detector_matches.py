"""Match detections with objects and measure their errors, alike for recordings and for the simulation; match false
detections between frames.

    python scripts/detector_matches.py DATA    # prints the classes that PointRCNN confuses on KITTI

Positions are in the axes of the detecting car (x forward, y left, z up). An object is found if a detection's center
is within `GATE_M` of its center over ground (Hungarian on the distance); unmatched detections are false.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np
from scipy.ndimage import uniform_filter

import coopsim
from coopsim.data.recording_set import RecordingSet
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.geometry.assignment import nearest_pairs
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.testing.harness import Idle
from coopsim.types import AgentSpec, Detections, GroundTruth, Ints, Mask, SensorView
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass
from coopsim.world.snapshot import Actors

AGENTS = ("ego", "1")
"""Names of the recordings' single-car detections; the first car owns the frame."""

GATE_M = 3.0
OWN_M = 2.5
"""Labels with a center nearer than this are the detecting car itself, as labelled for the other car."""

SENSOR_M = 1.9
"""Assumed height of the recordings' LiDAR over a flat road."""

NEAR_M = 1.5
"""Two false detections are the same if the later one is within this distance of the position expected for it."""

BESIDE_M = 15.0
"""Objects as near as this stand on the same ground, roughly."""

_POOLED = 5  # number of frames before and after that vote for one shift
_BIN_M = 0.1
_FASTEST_M, _ASIDE_M = 3.6, 1.0
_ELSEWHERE_M = np.array([0.0, 6.0])

CONFUSED = ("pointrcnn_Car", "pointrcnn_Cyclist", "pointrcnn_Pedestrian")
SMALL = (ObjectClass.PEDESTRIAN, ObjectClass.BICYCLE)

Note: TypeAlias = tuple[Ints, Actors, Detections]
"""Returns per actor around an agent, the actors, and the agent's detections."""


@dataclass
class Matches:
    """Rows of objects and of false detections; columns by name, (N,) each, once `close` has been called.

    Objects: episode, frame, object, x, y, returns, found, score, turned, and the errors along, across, up, length,
    width, height, yaw (NaN where not found). False ones: episode, frame, x, y, z, length, width, height, yaw, score.
    Both have `off`, how far the found box's underside is above that of the nearest other object within `BESIDE_M`.
    """

    objects: dict[str, Floats] = field(default_factory=dict)
    false: dict[str, Floats] = field(default_factory=dict)
    frames: int = 0
    _objects: list[dict[str, Floats]] = field(default_factory=list)
    _false: list[dict[str, Floats]] = field(default_factory=list)

    def add(self, episode: int, frame: int, ids: Ints, truth: Boxes3D, returns: Ints, found: Detections) -> None:
        """Add one frame of one car; boxes in its axes."""
        distance = np.linalg.norm(found.boxes.center[:, None, :2] - truth.center[None, :, :2], axis=2)
        mine, theirs = nearest_pairs(distance, GATE_M)
        of = np.full(len(ids), -1)
        of[theirs] = mine
        off = _off_the_ground(found.boxes, truth, distance, of)
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
                "off": np.append(off, np.nan)[of],
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
                "off": off[wrong],
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
            coopsim.run_episode(env, Idle(), seed=seed)
            for k, seen in enumerate(zip(*watch.notes.values(), strict=True)):
                visible = np.concatenate([truth.id[returns > 0] for returns, truth, _ in seen])
                for agent, (returns, truth, found) in enumerate(seen):
                    kept = np.isin(truth.id, visible)
                    boxes = truth.boxes[kept]
                    matches.add(episode + agent, k, truth.id[kept], boxes, returns[kept], found)
            episode += len(watch.notes)
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


def _off_the_ground(found: Boxes3D, truth: Boxes3D, distance: Floats, of: Ints) -> Floats:
    """Return how far the undersides of N found boxes are above that of the nearest object but their own, NaN if far.

    `distance` (N, M) is to the centers of M objects; `of` (M,) is the box of each, or -1.
    """
    if not len(truth) or not len(found):
        return np.full(len(found), np.nan)
    others = np.where(np.arange(len(found))[:, None] == of, np.inf, distance)
    beside = others.argmin(axis=1)
    below = truth.center[beside, 2] - truth.size[beside, 2] / 2
    off: Floats = np.where(others.min(axis=1) < BESIDE_M, found.center[:, 2] - found.size[:, 2] / 2 - below, np.nan)
    return off


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


@dataclass(frozen=True)
class Recurrence:
    """False detections that are found again some frames later.

    Attributes:
        share: of false detections found again, among those still within reach, less chance matches.
        first: rows of those found again.
        second: rows of the same ones, later.
        apart_m: (N, 2) displacement between the two, in the world.
        count: number of false detections looked for.
    """

    share: float
    first: Ints
    second: Ints
    apart_m: Floats
    count: int


class ClutterMotion:
    """False detections of all episodes, with the car's motion removed.

    The recordings have no poses. But most false detections stand still in the world, so between two frames most of them
    shift alike, and that shift is the car's motion, well enough for a few seconds, without turns.

    Args:
        false: columns `episode`, `frame`, `x`, `y` (N,).
        reach_m: half lengths of the area in which the detector reports boxes, along x and y.
    """

    def __init__(self, false: dict[str, Floats], reach_m: tuple[float, float]) -> None:
        self._place = np.column_stack([false["x"], false["y"]])
        self._reach_m = np.array(reach_m) - NEAR_M
        self._rows = {
            episode: _by_frame(false["frame"], np.flatnonzero(false["episode"] == episode))
            for episode in np.unique(false["episode"])
        }
        self._path = {episode: self._drift(rows) for episode, rows in self._rows.items()}

    def after(self, lag: int) -> Recurrence:
        """Match false detections with those `lag` frames later."""
        matched, chance, first, second, apart = 0, 0, [], [], []
        count = 0
        for episode, rows in self._rows.items():
            path = self._path[episode]
            for frame in range(len(rows) - lag):
                expected = self._place[rows[frame]] + path[frame + lag] - path[frame]
                inside = (np.abs(expected) <= self._reach_m).all(axis=1)
                expected, now = expected[inside], self._place[rows[frame + lag]]
                count += len(expected)
                if not len(expected) or not len(now):
                    continue
                distance = np.linalg.norm(expected[:, None] - now, axis=2)
                elsewhere = np.linalg.norm(expected[:, None] + _ELSEWHERE_M - now, axis=2)
                near = distance.min(axis=1) < NEAR_M
                matched, chance = matched + near.sum(), chance + (elsewhere.min(axis=1) < NEAR_M).sum()
                nearest = distance.argmin(axis=1)[near]
                first.append(rows[frame][inside][near])
                second.append(rows[frame + lag][nearest])
                apart.append(now[nearest] - expected[near])
        by_chance = chance / count
        share = max((matched / count - by_chance) / (1 - by_chance), 0.0)
        return Recurrence(share, np.concatenate(first), np.concatenate(second), np.concatenate(apart), count)

    def _drift(self, rows: list[Ints]) -> Floats:
        """Return the displacement (F, 2) m of the world relative to the car since the first frame."""
        votes = np.stack([self._votes(rows[k], rows[k + 1]) for k in range(len(rows) - 1)])
        summed = np.cumsum(np.concatenate([np.zeros_like(votes[:1]), votes]), axis=0)
        steps = []
        for k in range(len(votes)):
            pooled = summed[min(k + _POOLED + 1, len(votes))] - summed[max(k - _POOLED, 0)]
            peak = np.unravel_index(np.argmax(uniform_filter(pooled, 5)), pooled.shape)
            steps.append([(peak[0] + 0.5) * _BIN_M - _FASTEST_M, (peak[1] + 0.5) * _BIN_M - _ASIDE_M])
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def _votes(self, before: Ints, after: Ints) -> Floats:
        """Return a histogram of the shifts of all pairs of two frames, in bins along and across."""
        shift = (self._place[after][None] - self._place[before][:, None]).reshape(-1, 2)
        bins = [np.arange(-_FASTEST_M, _ASIDE_M, _BIN_M), np.arange(-_ASIDE_M, _ASIDE_M + _BIN_M / 2, _BIN_M)]
        votes: Floats = np.histogram2d(shift[:, 0], shift[:, 1], bins)[0]
        return votes


def _by_frame(frame: Floats, rows: Ints) -> list[Ints]:
    """Split rows by frame, from 0 to the last."""
    numbers = frame[rows].astype(np.int64)
    order = np.argsort(numbers, kind="stable")
    ends = np.cumsum(np.bincount(numbers))
    return np.split(rows[order], ends[:-1])


def print_confusion(data: Path) -> None:
    """Print how often PointRCNN confuses classes on KITTI, of a folder with kitti (labels/ and detections/).

    Each labelled object takes the class of its surest detection within 2 m (1 m for people and cyclists) of which it is
    the nearest object. Detections are of cars, pedestrians and cyclists only; those of negative scores are left out.
    """
    recordings = RecordingSet(data / "kitti")
    counts: Counter[tuple[str, str]] = Counter()
    again: Counter[bool] = Counter()
    for sequence in recordings.sequences:
        recording = recordings.load(sequence, CONFUSED)
        before: dict[int, bool] = {}
        for frame, truth in enumerate(recording.truth):
            found = Detections.concatenate(each[frame] for each in recording.detections.values())
            reported = reported_classes(truth, found[found.score >= 0])
            now = {}
            for identity, label, other in zip(truth.id.tolist(), truth.label, reported, strict=True):
                if other < 0:
                    continue
                counts[CLASS_NAMES[label], CLASS_NAMES[other]] += 1
                if label in SMALL:
                    now[identity] = bool(label != other)
                    if before.get(identity):
                        again[now[identity]] += 1
            before = now
    for (true, reported_as), count in sorted(counts.items()):
        row = sum(each for (name, _), each in counts.items() if name == true)
        print(f"{true:>10} reported as {reported_as:<10} {count:6} of {row}: {count / row:.3f}")
    print(f"a person's or cyclist's wrong label is wrong again in the next frame: {again[True] / again.total():.2f}")


def reported_classes(truth: GroundTruth, found: Detections) -> Ints:
    """Return the class that each object is reported as, (N,), -1 for objects that are not found."""
    reported = np.full(len(truth), -1)
    if not (len(truth) and len(found)):
        return reported
    gap_m = np.linalg.norm(truth.boxes.center[:, None, :2] - found.boxes.center[None, :, :2], axis=2)
    near = gap_m < np.where(np.isin(truth.label, SMALL), 1.0, 2.0)[:, None]
    near &= gap_m.argmin(axis=0) == np.arange(len(truth))[:, None]
    surest = np.where(near, found.score, -np.inf).argmax(axis=1)
    some = near.any(axis=1)
    reported[some] = found.label[surest[some]]
    return reported


if __name__ == "__main__":
    print_confusion(Path(sys.argv[1]))
