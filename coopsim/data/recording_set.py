"""Recording sets: a folder with `labels/<sequence>.txt` and `detections/<name>/<sequence>.txt`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from coopsim.data.kitti import read_detections, read_labels
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.support.checks import require_choice
from coopsim.types import Detections, GroundTruth, Ints

_LAYOUT = "a recording set has labels/<sequence>.txt and detections/<name>/<sequence>.txt"

Part = TypeVar("Part")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One sequence.

    Attributes:
        frames: how many frames; every frame from 0 to the last that any file mentions.
        truth: (frames) the labelled objects.
        detections: by name, (frames) the detections.
    """

    frames: int
    truth: Sequence[GroundTruth]
    detections: Mapping[str, Sequence[Detections]]


class RecordingSet:
    """The sequences below a folder; files are read when a sequence is loaded.

    Args:
        path: the folder.

    Raises:
        InvalidValueError: it is not a path (None is not).
        RecordingError: it is not a recording set; the message says what is missing.
    """

    def __init__(self, path: str | Path | None) -> None:
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
        """The names of detections, each once; a text is one name.

        Raises:
            InvalidValueError: it is not a name or a sequence of names, or one stands in it twice.
            UnknownNameError: there is no detection folder of that name.
        """
        if not isinstance(names, Sequence):
            accepted = ", ".join(self.detection_names)
            raise InvalidValueError(f"detections must be a sequence of names, got {names!r}; accepted: {accepted}")
        chosen = (names,) if isinstance(names, str) else tuple(names)
        for name in chosen:
            require_choice(f"detections in {self.path}", name, self.detection_names)
            if chosen.count(name) > 1:
                raise InvalidValueError(f"detections must be different names, got {name!r} more than once")
        return chosen

    def most_objects(self) -> int:
        """The largest number of labelled objects in a frame of any sequence; reads all label files.

        Raises:
            RecordingError: a file is missing or broken; the message names file and line.
        """
        frames = (read_labels(self._labels(sequence))[0] for sequence in self.sequences)
        return max(int(np.unique(frame, return_counts=True)[1].max(initial=0)) for frame in frames)

    def load(self, sequence: str, names: Sequence[str]) -> Recording:
        """Read one sequence with the detections called `names`, which may be none.

        Raises:
            InvalidValueError: `names` is not a name or a sequence of different names.
            UnknownNameError: no such sequence or detections.
            RecordingError: a file is missing or broken; the message names file and line.
        """
        require_choice(f"sequence in {self.path}", sequence, self.sequences)
        names = self.require_detections(names)
        truth_frame, truth_id, truth_boxes, truth_label, last = read_labels(self._labels(sequence))
        found = {name: read_detections(self.path / "detections" / name / f"{sequence}.txt") for name in names}
        frames = 1 + max([last, *(int(frame.max(initial=-1)) for frame, *_ in found.values())])

        def truth_in(rows: Ints) -> GroundTruth:
            return GroundTruth(truth_id[rows], truth_boxes[rows], truth_label[rows])

        truth = _by_frame(truth_frame, frames, truth_in, GroundTruth.empty())
        detections = {
            name: _by_frame(frame, frames, Detections(boxes, score, label).__getitem__, Detections.empty())
            for name, (frame, boxes, score, label) in found.items()
        }
        return Recording(frames, truth, detections)

    def _labels(self, sequence: str) -> Path:
        return self.path / "labels" / f"{sequence}.txt"


def _by_frame(frame: Ints, frames: int, take: Callable[[Ints], Part], nothing: Part) -> list[Part]:
    """What `take` gives of the rows of each frame, in the file's order; all frames without rows share `nothing`."""
    parts = [nothing] * frames
    order = np.argsort(frame, kind="stable")
    present, starts = np.unique(frame[order], return_index=True)
    for number, (start, end) in zip(present, itertools.pairwise([*starts, len(order)]), strict=True):
        parts[number] = take(order[start:end])
    return parts
