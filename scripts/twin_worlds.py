"""Twins of V2V4Real's recordings: what its labels say of the world, as logs that coopsim plays and senses anew.

Ids up to 100 are labels of the first car; the others are of objects that the second car alone labelled (with the poses
that the data set gives, so they lie off by the error between both cars' poses).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from detector_matches import AGENTS, GATE_M, Watch
from numpy.typing import NDArray

import coopsim
from coopsim.data.ego_motion import EgoMotion
from coopsim.data.logs.filling import Columns, make_log
from coopsim.data.logs.summary import write_table
from coopsim.data.recorded_path import RecordedPath, Sightings, in_world, recover_path, residuals_of
from coopsim.data.recording_set import Recording
from coopsim.data.second_car import OWN_M, SecondCar, find_second_car
from coopsim.detection.oracle import OracleDetector
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.testing.harness import Idle
from coopsim.types import Detections, Ints, Mask

LIDAR = LidarConfig("VLP-32C", columns=1800)
"""Of both cars, 1.9 m above the road: 32 beams at 10 Hz in steps of 0.2 degrees."""

FRAME_S, LONGEST = 0.1, 320
"""Time between frames, and the most frames of a part: a place reaches 600 m."""

FIRST_IDS = 100
SAME_M = 2.0
"""Labels of both cars that are nearer to each other are of one object."""

LEAP_M = 10.0
"""Displacement in a frame beyond what cars do to each other."""

_CAR_M = np.array([4.6, 1.85, 1.55])
"""Size of both cars where no label says it; a label's height includes what stands on the roof."""

_REACH_M = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """All labels of a recording: N rows, by frame.

    Attributes:
        frame: (N,) frame.
        id: (N,) object.
        boxes: (N) in the first car's frame.
        size: (N, 3) m, the median of the object's labels, whose sizes change.
        own: (N,) they are of the first car itself, by the second one.
        late: (N,) the second car alone labelled them.
        of: (N,) row of the first car's label of the same object; else the row itself.
    """

    frame: Ints
    id: Ints
    boxes: Boxes3D
    size: Floats
    own: Mask
    late: Mask
    of: Ints

    @classmethod
    def read(cls, recording: Recording) -> Labels:
        """Return the labels of a recording."""
        frame = np.repeat(np.arange(recording.frames), [len(each) for each in recording.truth])
        identity = np.concatenate([each.id for each in recording.truth])
        boxes = Boxes3D.from_array(np.concatenate([each.boxes.array for each in recording.truth]))
        own = np.hypot(*boxes.center[:, :2].T) < OWN_M
        late, of = identity > FIRST_IDS, np.arange(len(frame))
        for k in range(recording.frames):
            mine, theirs = (np.flatnonzero((frame == k) & (late == each) & ~own) for each in (False, True))
            if len(mine) and len(theirs):
                apart = np.hypot(*(boxes.center[theirs, None, :2] - boxes.center[mine, :2]).transpose(2, 0, 1))
                of[theirs] = np.where(apart.min(axis=1) < SAME_M, mine[apart.argmin(axis=1)], theirs)
        medians = {k: np.median(boxes.size[identity == k], axis=0) for k in np.unique(identity).tolist()}
        return cls(frame, identity, boxes, np.array([medians[k] for k in identity.tolist()]), own, late, of)

    @property
    def objects(self) -> Ints:
        """Rows of the world's objects, each once a frame, without the first car."""
        return np.flatnonzero(~self.own & (self.of == np.arange(len(self.of))))


@dataclass(frozen=True, slots=True, eq=False)
class TwinWorld:
    """What a recording's labels say of its world."""

    recording: Recording
    labels: Labels
    seen: Sightings
    steps: Floats
    path: RecordedPath
    second: SecondCar

    @classmethod
    def of(cls, recording: Recording) -> TwinWorld:
        """Recover the world of a recording, in axes "v2v4real"."""
        labels = Labels.read(recording)
        rows = labels.objects
        rows = rows[np.lexsort((labels.frame[rows], labels.id[rows]))]
        seen = Sightings(labels.frame[rows], labels.id[rows], labels.boxes.center[rows, :2])
        steps = first_estimate(recording)
        path = recover_path(seen, steps)
        return cls(recording, labels, seen, steps, path, find_second_car(recording, AGENTS, path.pose))

    def halves(self) -> tuple[tuple[RecordedPath, Floats], ...]:
        """Return the paths by each half of the objects, and what the other half leaves over there, (N, 2) m."""
        of = self.seen.object % 2
        parts = [Sightings(self.seen.frame[k], self.seen.object[k], self.seen.place[k]) for k in (of == 0, of == 1)]
        paths = [recover_path(each, self.steps) for each in parts]
        return tuple((path, residuals_of(parts[1 - k], path.pose)[1]) for k, path in enumerate(paths))

    @property
    def parts(self) -> list[Ints]:
        """Frames of each part that is played at once."""
        frames = np.arange(self.recording.frames)
        return np.array_split(frames, -(-len(frames) // LONGEST))

    def write_log(self, path: Path, frames: Ints) -> None:
        """Write some frames as a table of a log, in the world's frame, from the time 0 on."""
        labels, rows = self.labels, self.labels.objects
        rows = rows[np.isin(labels.frame[rows], frames) & ~self.is_second(rows)]
        boxes, when = labels.boxes[rows], labels.frame[rows]
        first, second = (np.tile(self.car_size_m(k), (len(frames), 1)) for k in (0, 1))
        columns = [
            (
                self._names(rows),
                when,
                boxes.center[:, :2],
                boxes.yaw,
                labels.size[rows],
            ),
            (np.array(["first"] * len(frames)), frames, np.zeros((len(frames), 2)), np.zeros(len(frames)), first),
            (
                np.array(["second"] * len(frames)),
                frames,
                self.second.place[frames],
                self.second.heading[frames],
                second,
            ),
        ]
        names, when, place, heading, size = (np.concatenate(part) for part in zip(*columns, strict=True))
        log = make_log(
            str(path),
            "V2V4Real",
            Columns(
                time_s=(when - frames[0]) * FRAME_S,
                id=names,
                label=np.zeros(len(when), np.int64),
                xy=in_world(place, self.path.pose[when]),
                heading=wrap_angle(heading + self.path.pose[when, 2]),
                size=size,
                step_s=FRAME_S,
            ),
        )
        write_table(path, log)

    def _names(self, rows: Ints) -> NDArray[np.str_]:
        """Return names of labelled objects; an id that goes on elsewhere, by a leap, is another object's from there."""
        labels = self.labels
        order = np.lexsort((labels.frame[rows], labels.id[rows]))
        frame, identity, at = (column[rows][order] for column in (labels.frame, labels.id, labels.boxes.center[:, :2]))
        leaps = np.hypot(*np.diff(at, axis=0).T) > LEAP_M * np.diff(frame)
        number = np.zeros(len(rows), np.int64)
        number[order[1:]] = np.cumsum(leaps & (np.diff(identity) == 0))
        return np.array([f"object {k} {n}" for k, n in zip(labels.id[rows], number, strict=True)])

    def car_size_m(self, number: int) -> Floats:
        """Return the size (3,) of the first or second car."""
        labels = self.labels
        rows = np.flatnonzero(labels.own if number == 0 else labels.id == self.second.label[labels.frame])
        if not len(rows):
            return _CAR_M
        return np.append(np.median(labels.size[rows, :2], axis=0), _CAR_M[2])

    def is_second(self, rows: Ints) -> Mask:
        """Return which labels are of the second car."""
        frame = self.labels.frame[rows]
        away = np.hypot(*(self.labels.boxes.center[rows, :2] - self.second.place[frame]).T)
        mask: Mask = (self.labels.id[rows] == self.second.label[frame]) | (away < OWN_M)
        return mask


def first_estimate(recording: Recording) -> Floats:
    """Return motions (F, 3) since the frame before by boxes of both cars that no label has: these stand, mostly.

    On a motorway all labelled cars go alike, and would pass for standing ones. Motion aside is left out: cars roll.
    """
    estimator, steps = EgoMotion(FRAME_S), []
    for k, truth in enumerate(recording.truth):
        parts = []
        for number, name in enumerate(AGENTS):
            found = recording.detections[name][k]
            away = np.linalg.norm(found.boxes.center[:, None, :2] - truth.boxes.center[:, :2], axis=2)
            false = found[away.min(axis=1, initial=np.inf) > GATE_M]
            parts.append(Detections(false.boxes, false.score, np.full(len(false), number)))
        steps.append(estimator.step(Detections.concatenate(parts)))
    return np.array(steps) * [1.0, 0.0, 1.0]


def sense(log: Path, middle: Sequence[float], frames: int, detector: OracleDetector, seed: int) -> Watch:
    """Play a log; return the notes of the detector by agent: cav_0 is the first car, cav_1 the second."""
    watch = Watch(detector)
    env = coopsim.parallel_env(
        str(log),
        cars="first,second",
        start_s=0.0,
        least_s=(frames - 1) * FRAME_S,
        around=tuple(middle),
        radius_m=_REACH_M,
        dt_s=FRAME_S,
        max_cycles=frames,
        lidar=LIDAR,
        detector=watch,
        uplink="none",
    )
    coopsim.run_episode(env, Idle(), seed=seed)
    env.close()
    return watch
