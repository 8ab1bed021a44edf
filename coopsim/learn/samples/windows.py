"""Windows of recordings or simulated clips for the training of a filter: detections, labels, and the tracks in them.

Tracks are AB3DMOT's, with its own noise, the agents in turn: the association does not depend on what is learned.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coopsim.data.kitti import AXES
from coopsim.data.recording_set import Recording, RecordingSet
from coopsim.errors import InvalidValueError
from coopsim.geometry.assignment import Pairs, greedy, hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import center_distance_bev
from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.samples.sample_frames import sweeps_of
from coopsim.nn.covariance.box_numbers import NUMBERS, box_numbers, own_numbers
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.support.checks import require_choice, require_count, require_flag, require_frame_time
from coopsim.support.rng import stream
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import MEASURED, ConstantVelocity
from coopsim.tracking.track_states import TrackStates
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, GroundTruth, Ints, seconds_to_ns
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import drop_invalid

DATA = "COOPSIM_DATA"
"""The environment variable with the folder that relative paths begin at."""

VALIDATION = ("0000",)
"""Recordings among V2V4Real's training recordings that are validation recordings."""


@dataclass(frozen=True, slots=True)
class RecordedWorld:
    """The option `world` of trainings on recordings.

    Attributes:
        path: folder of a recording set, absolute or relative to `COOPSIM_DATA`.
        detections: names of detections, the frame's owner first.
        without: recordings that are not used.
        held_out: recordings to choose by, which are not trained on.
        axes: convention of the files' axes, see `coopsim.data.kitti`.
        dt_s: time between two frames.
        frames: frames in a window.
        allow_validation: recordings of V2V4Real's validation among the training ones may be used.
    """

    path: str = "v2v4real/train"
    detections: tuple[str, ...] = ("ego", "1")
    without: tuple[str, ...] = VALIDATION
    held_out: tuple[str, ...] = ("0026", "0027", "0028", "0029", "0030", "0031")
    axes: str = "kitti"
    dt_s: float = 0.1
    frames: int = 20
    allow_validation: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.path, (str, Path)):
            raise InvalidValueError(f"path must be the folder of a recording set, got {self.path!r}")
        for name in ("detections", "without", "held_out"):
            given = getattr(self, name)
            if not isinstance(given, (tuple, list)) or not all(isinstance(each, str) for each in given):
                raise InvalidValueError(f"{name} must be names, as [0000, 0001], got {given!r}")
            object.__setattr__(self, name, tuple(given))
        require_choice("axes", self.axes, AXES)
        require_frame_time(self.dt_s)
        require_count(2, 1000, frames=self.frames)
        require_flag(allow_validation=self.allow_validation)
        if not self.detections:
            raise InvalidValueError("detections must be at least one name, got none")

    def folder(self) -> RecordingSet:
        """Return the recording set.

        Raises:
            InvalidValueError: the path is relative, and `COOPSIM_DATA` is not set.
            RecordingError: there is none.
        """
        path, root = Path(self.path).expanduser(), os.environ.get(DATA)
        if not path.is_absolute():
            if root is None:
                raise InvalidValueError(
                    f"world.path must be absolute, or {DATA} the folder in which {self.path!r} is, got no {DATA}"
                )
            path = Path(root) / path
        return RecordingSet(path, self.axes)

    def trained_on(self, known: Sequence[str]) -> tuple[str, ...]:
        """Return the recordings of a set to train on.

        Raises:
            UnknownNameError: a recording to hold out is not there.
            InvalidValueError: none is left, or a validation recording is among them.
        """
        for name in self.held_out:
            require_choice("held_out", name, known)
        kept = tuple(name for name in known if name not in (*self.without, *self.held_out))
        if not kept:
            raise InvalidValueError(f"there must be a recording to train on besides {', '.join(known)}")
        forbidden = [name for name in VALIDATION if name in kept]
        if forbidden and not self.allow_validation:
            raise InvalidValueError(
                f"without must have {', '.join(forbidden)}, which V2V4Real validates on: leave it out, or say "
                "allow_validation if these are other recordings"
            )
        return kept


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """The T frames of a recording.

    Attributes:
        found: (T) the valid detections of all agents, the frame's owner first.
        truth: (T) the labels.
        numbers: (M, 19) of all detections, frame by frame and agent by agent, see `box_numbers`.
        dt_s: time between two frames.
    """

    found: tuple[DetectionGroups, ...]
    truth: tuple[GroundTruth, ...]
    numbers: Floats
    dt_s: float


def frames_of(recording: Recording, dt_s: float) -> RecordedFrames:
    """Return the frames of a recording."""
    agents = [[drop_invalid(each) for each in found] for found in recording.detections.values()]
    groups = tuple(DetectionGroups.of(each) for each in zip(*agents, strict=True))
    numbers = np.concatenate([np.zeros((0, NUMBERS)), *(_numbers(each) for each in groups)])
    return RecordedFrames(groups, tuple(recording.truth), numbers, dt_s)


def _numbers(groups: DetectionGroups) -> Floats:
    """Return the numbers (N, 19) of one frame: its owner is the origin, where the others were is not recorded."""
    sensors = np.full((len(groups), 4), np.nan)
    sensors[:1] = 0.0
    return box_numbers(groups.joined.boxes.array, groups.joined.score, groups.group, sensors)


GATE, AGE = -0.2, 2
"""Smallest 3D GIoU of a match, and frames without a detection until a track ends: AB3DMOT's."""

SAME_OBJECT_M = 4.0
"""Largest distance of a track and its label on the ground, as in DMSTrack."""

NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class WindowTracks:
    """The K tracks in T frames with A agents.

    Attributes:
        detection: (T, A, K) number of the agent's detection among the M of all frames; `NONE` without.
        truth: (T, K, 7) box of the label near a track that was detected in the frame; NaN without.
        boxes: (M, 7) the detections.
    """

    detection: Ints
    truth: Floats
    boxes: Floats

    def cut(self, first: int, frames: int) -> tuple[WindowTracks, Ints]:
        """Return some frames, with the tracks that are detected in them, and the numbers (m,) of their detections."""
        detection = self.detection[first : first + frames]
        seen = (detection != NONE).any(axis=(0, 1))
        detection, truth = detection[:, :, seen], self.truth[first : first + frames, seen]
        rows = np.unique(detection[detection != NONE])
        numbered = np.where(detection == NONE, NONE, np.searchsorted(rows, detection))
        return WindowTracks(numbered, truth, self.boxes[rows]), rows


class _Watched(Cascade):
    """Association that keeps its pairs: the ids of tracks and the rows of their detections, by group."""

    def __init__(self, stages: Sequence[Stage]) -> None:
        super().__init__(stages)
        self.groups: list[tuple[Ints, Ints]] = []

    def match(self, tracks: TrackStates, detections: Detections) -> Pairs:
        rows, columns = super().match(tracks, detections)
        self.groups.append((tracks.id[rows], columns))
        return rows, columns


def track_frames(frames: RecordedFrames, variance: Floats, motion: ConstantVelocity) -> WindowTracks:
    """Track a recording with AB3DMOT's association and lifecycle, the agents in turn, by variances (M, 7)."""
    watched = _Watched([Stage(giou_3d, hungarian, gate=GATE)])
    tracker = Tracker(motion, watched, HitsAndAge(age=AGE))
    taken: list[tuple[int, int, Ints, Ints]] = []  # frame, agent, ids of tracks, rows of detections
    true: list[tuple[int, Ints, Floats]] = []  # frame, ids of tracks, boxes
    row, tracks = 0, 0
    for frame, groups in enumerate(frames.found):
        sizes = np.diff(groups.starts)
        spread = replace(groups.joined, covariance=diagonals(variance[row : row + len(groups.joined)]))
        watched.groups.clear()
        tracker.step_in_turn(DetectionGroups(spread, groups.starts), seconds_to_ns(frame * frames.dt_s))
        for agent, (known, columns) in zip(np.flatnonzero(sizes), watched.groups, strict=True):
            new = np.setdiff1d(np.arange(sizes[agent]), columns)
            ids = np.concatenate([known - 1, tracks + np.arange(len(new))])
            rows = row + groups.starts[agent] + np.concatenate([columns, new])
            taken.append((frame, int(agent), ids, rows))
            tracks += len(new)
        row += len(groups.joined)
        true.append((frame, *_labels_near(tracker.state.tracked, frames.truth[frame])))
    return _as_arrays(frames, tracks, taken, true)


def _labels_near(tracked: TrackStates, truth: GroundTruth) -> tuple[Ints, Floats]:
    """Return the numbers (K,) of the tracks that were detected now and are near a label, and its box (K, 7)."""
    detected = np.flatnonzero(tracked.misses == 0)
    near = center_distance_bev(tracked.boxes[detected], truth.boxes.array)
    rows, columns = greedy(near, -SAME_OBJECT_M)
    return tracked.id[detected[rows]] - 1, truth.boxes.array[columns]


def _as_arrays(
    recorded: RecordedFrames,
    tracks: int,
    taken: Sequence[tuple[int, int, Ints, Ints]],
    true: Sequence[tuple[int, Ints, Floats]],
) -> WindowTracks:
    frames, agents = len(recorded.found), max((len(groups) for groups in recorded.found), default=0)
    detection = np.full((frames, agents, tracks), NONE)
    truth = np.full((frames, tracks, MEASURED), np.nan)
    for frame, agent, ids, rows in taken:
        detection[frame, agent, ids] = rows
    for frame, ids, boxes in true:
        truth[frame, ids] = boxes
    boxes = np.concatenate([np.zeros((0, MEASURED)), *(groups.joined.boxes.array for groups in recorded.found)])
    return WindowTracks(detection, truth, boxes)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedWindow:
    """Successive frames of a recording, and the tracks in them.

    Attributes:
        numbers: (M, 19) of the window's detections, see `box_numbers`.
        tracks: detections of each track.
        dt_s: time between two frames.
        heading_rad: (M,) of the agents that detected them, in the frame of the boxes: variances are along and across
            it; None: along the axes of the frame, the owner's.
        patches: (M, 9 C) of `box_patches`; None: the recording has no features.
    """

    numbers: Floats
    tracks: WindowTracks
    dt_s: float
    heading_rad: Floats | None = None
    patches: Floats | None = None


class RecordedWindows:
    """Windows of the recordings that are trained on, by number: one recording after the other, from a random frame.

    Raises:
        CoopsimError: a folder or file is missing or broken, or no recording is left to train on.
    """

    def __init__(self, world: RecordedWorld, seed: int) -> None:
        folder = world.folder()
        self._world, self._seed = world, seed
        self._recordings = [
            frames_of(folder.load(name, world.detections), world.dt_s) for name in world.trained_on(folder.sequences)
        ]
        self._tracks: dict[int, WindowTracks] = {}

    def clip(self, index: int) -> RecordedWindow:
        """Return a window: the same for the same index."""
        number = index % len(self._recordings)
        recording, length = self._recordings[number], self._world.frames
        if number not in self._tracks:
            self._tracks[number] = track_frames(recording, np.ones((len(recording.numbers), 7)), ConstantVelocity())
        last = max(0, len(recording.found) - length)
        first = int(stream(self._seed, "training.window", str(index)).integers(last + 1))
        tracks, rows = self._tracks[number].cut(first, length)
        return RecordedWindow(recording.numbers[rows], tracks, recording.dt_s)


REACH_M, LEAST_SCORE = 76.8, 0.1
"""Half the edge of the square in which an agent looks for objects, and the smallest score: the detector's defaults."""


def detected_window(clip: Clip, detector: CloudDetector) -> RecordedWindow:
    """Return a clip as a filter sees it: boxes in the world's frame, by true poses, the rest in the agents' frames."""
    found: list[DetectionGroups] = []
    numbers, patches, heading_rad = [np.zeros((0, NUMBERS))], [], []
    for number, scene in enumerate(clip.scenes):
        groups = []
        for member, agent in enumerate(scene.agents):
            points = sweeps_of(clip, number, member, detector.sweeps)
            seen, looks = detector.detect_patches(points, REACH_M, LEAST_SCORE)
            groups.append(Detections(seen.boxes, seen.score, seen.label).transform(_world_SE3_base(agent)))
            numbers.append(own_numbers(seen.boxes.array, seen.score))
            patches.append(looks)
            heading_rad.append(np.full(len(seen), agent.xyz_yaw[3]))
        found.append(DetectionGroups.of(groups))
    frames = RecordedFrames(tuple(found), _truth(clip.scenes), np.concatenate(numbers), clip.dt_s)
    tracks = track_frames(frames, np.ones((len(frames.numbers), 7)), ConstantVelocity())
    return RecordedWindow(frames.numbers, tracks, clip.dt_s, np.concatenate(heading_rad), np.concatenate(patches))


def _world_SE3_base(agent: AgentScene) -> SE3:
    return SE3.from_xyz_yaw(agent.xyz_yaw[:3], agent.xyz_yaw[3])


def _truth(scenes: Sequence[Scene]) -> tuple[GroundTruth, ...]:
    """Return the objects of each scene that a LiDAR hits."""
    shown: list[tuple[Scene, Floats]] = [(scene, scene.returns.max(axis=1) > 0) for scene in scenes]
    return tuple(
        GroundTruth(scene.object_id[seen], Boxes3D.from_array(scene.boxes[seen]), scene.label[seen])
        for scene, seen in shown
    )
