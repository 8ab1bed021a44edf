"""Recording sets: folders with `labels/<sequence>.txt` and `detections/<name>/<sequence>.txt`.

There may be `poses/<sequence>.txt`, too: where the car was in whose frame the recording is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from coopsim.data.ego_motion import EgoMotion
from coopsim.data.kitti import AXES, read_detections, read_labels, read_poses
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_choice
from coopsim.types import Detections, GroundTruth, Ints

ODOMETRY = ("auto", "poses", "estimated", "none")
"""Sources of a recording car's motion."""

_LAYOUT = "a recording set has labels/<sequence>.txt and detections/<name>/<sequence>.txt"

_TYPES = ("Car", "Pedestrian", "Cyclist")  # ends of names, where a detector's files are split by class

Part = TypeVar("Part")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Sequence of a recording set.

    Attributes:
        frames: number of frames; every frame from 0 to the last that any file mentions.
        truth: (frames) the labelled objects.
        detections: (frames) detections, by name.
    """

    frames: int
    truth: Sequence[GroundTruth]
    detections: Mapping[str, Sequence[Detections]]

    def first(self, frames: int | None) -> Recording:
        """Return at most the first frames; None: all."""
        cut = slice(frames)
        detections = {name: each[cut] for name, each in self.detections.items()}
        return Recording(len(self.truth[cut]), self.truth[cut], detections)


class RecordingSet:
    """The sequences below a folder; files are read when a sequence is loaded.

    Args:
        path: the folder.
        axes: convention of the files' axes: "kitti" or "v2v4real", see `coopsim.data.kitti`.

    Raises:
        InvalidValueError: `path` is not a path (None is not).
        UnknownNameError: there is no such convention.
        RecordingError: the folder is not a recording set; the message says what is missing.
    """

    def __init__(self, path: str | Path | None, axes: str = "kitti") -> None:
        require_choice("axes", axes, AXES)
        self._axes = axes
        if not isinstance(path, (str, Path)):
            raise InvalidValueError(f"path must be the folder of a recording set, got {path!r}; {_LAYOUT}")
        self.path = Path(path)
        labels, detections = self.path / "labels", self.path / "detections"
        try:
            for folder in (self.path, labels, detections):
                if not folder.is_dir():
                    raise RecordingError(f"no folder {folder}: {_LAYOUT}")
            self.sequences = tuple(sorted(file.stem for file in labels.glob("*.txt")))
            self.detection_names = tuple(sorted(folder.name for folder in detections.iterdir() if folder.is_dir()))
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
        if not self.sequences:
            raise RecordingError(f"no label files: {labels} has no <sequence>.txt")

    def require_detections(self, names: Sequence[str] | None) -> tuple[str, ...]:
        """Return names of detections as a tuple; a text is one name.

        Raises:
            InvalidValueError: `names` is not a name or a sequence of names, or has one twice.
            UnknownNameError: there is no detection folder of that name.
        """
        if not isinstance(names, Sequence):
            accepted = ", ".join(self.detection_names)
            raise InvalidValueError(f"detections must be a sequence of names, got {names!r}; accepted: {accepted}")
        chosen = (names,) if isinstance(names, str) else tuple(names)
        for name in chosen:
            require_choice("detections", name, self.detection_names, f"in {self.path}")
            if chosen.count(name) > 1:
                raise InvalidValueError(f"detections must be different names, got {name!r} more than once")
        return chosen

    def most_objects(self) -> int:
        """Return the largest number of labelled objects in a frame of any sequence; reads all label files.

        Raises:
            RecordingError: a file is missing or broken; the message names file and line.
        """
        frames = (read_labels(self._labels(sequence), self._axes)[0] for sequence in self.sequences)
        return max(int(np.unique(frame, return_counts=True)[1].max(initial=0)) for frame in frames)

    def load(self, sequence: str, names: Sequence[str]) -> Recording:
        """Read one sequence with the detections called `names`, which may be none.

        Raises:
            InvalidValueError: `names` is not a name or a sequence of different names.
            UnknownNameError: no such sequence or detections.
            RecordingError: a file is missing or broken; the message names file and line.
        """
        require_choice("sequence", sequence, self.sequences, f"in {self.path}")
        names = self.require_detections(names)
        truth_frame, truth_id, truth_boxes, truth_label, last = read_labels(self._labels(sequence), self._axes)
        found = {name: self._read(name, sequence) for name in names}
        frames = 1 + max([last, *(int(frame.max(initial=-1)) for frame, *_ in found.values())])

        def truth_in(rows: Ints) -> GroundTruth:
            return GroundTruth(truth_id[rows], truth_boxes[rows], truth_label[rows])

        truth = _by_frame(truth_frame, frames, truth_in, GroundTruth.empty())
        detections = {name: _in_frames(*rows, frames) for name, rows in found.items()}
        return Recording(frames, truth, detections)

    def motions(
        self, sequence: str, recording: Recording, owner: str, dt_s: float, odometry: str = "auto"
    ) -> list[SE3]:
        """Return `previous_SE3_current` of the recording car for every frame, gravity-aligned; first the identity.

        Args:
            sequence: name of the sequence.
            recording: recording that `load` read.
            owner: name of the detections of the car in whose frame the recording is. Its motion is estimated from
                all classes of its detector: where files are split by class, as `pointrcnn_Car` and
                `pointrcnn_Cyclist`, from all of these.
            dt_s: time between two frames.
            odometry: "poses" reads `poses/<sequence>.txt`, "estimated" uses `coopsim.data.ego_motion`, "auto" does the
                first where there is such a file, else the second. "none" says that the car stands.

        Raises:
            UnknownNameError: there is no such odometry.
            RecordingError: a file is missing or broken; the message names file and line.
        """
        require_choice("odometry", odometry, ODOMETRY)
        path, frames = self.path / "poses" / f"{sequence}.txt", recording.frames
        if odometry == "none":
            return [SE3.identity()] * frames
        if odometry == "poses" or (odometry == "auto" and path.is_file()):
            poses = read_poses(path, frames, self._axes)
            steps = [a.inverse().compose(b) for a, b in itertools.pairwise(poses)]
            # Boxes and odometry are gravity-aligned: the car's tilt is left out.
            return [SE3.identity(), *(SE3.from_xyz_yaw(step.translation, step.yaw) for step in steps)]
        estimator = EgoMotion(dt_s)
        detections = [
            recording.detections.get(name) or _in_frames(*self._read(name, sequence), frames)
            for name in self._same_detector(owner)
        ]
        planar = [estimator.step(Detections.concatenate(parts)) for parts in zip(*detections, strict=True)]
        return [SE3.from_xyz_yaw([x, y, 0.0], yaw) for x, y, yaw in planar]

    def _same_detector(self, name: str) -> list[str]:
        """Return the names of all files of one detector: those that differ in the class at their end only."""
        stem, _, kind = name.rpartition("_")
        every = [f"{stem}_{each}" for each in _TYPES] if kind in _TYPES else [name]
        return [each for each in every if each in self.detection_names]

    def _labels(self, sequence: str) -> Path:
        return self.path / "labels" / f"{sequence}.txt"

    def _read(self, name: str, sequence: str) -> tuple[Ints, Boxes3D, Floats, Ints]:
        return read_detections(self.path / "detections" / name / f"{sequence}.txt", self._axes)


def _in_frames(frame: Ints, boxes: Boxes3D, score: Floats, label: Ints, frames: int) -> list[Detections]:
    """Sort detections into frames; those of later frames are left out."""
    rows = np.flatnonzero(frame < frames)
    detections = Detections(boxes[rows], score[rows], label[rows])
    return _by_frame(frame[rows], frames, detections.__getitem__, Detections.empty())


def _by_frame(frame: Ints, frames: int, take: Callable[[Ints], Part], nothing: Part) -> list[Part]:
    """Apply `take` to the rows of each frame, in the file's order; all frames without rows share `nothing`."""
    parts = [nothing] * frames
    order = np.argsort(frame, kind="stable")
    present, starts = np.unique(frame[order], return_index=True)
    for number, (start, end) in zip(present, itertools.pairwise([*starts, len(order)]), strict=True):
        parts[number] = take(order[start:end])
    return parts
