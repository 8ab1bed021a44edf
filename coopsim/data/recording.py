"""Recording sets: a folder with `labels/<sequence>.txt` and `detections/<name>/<sequence>.txt`."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coopsim.data.kitti import read_detections, read_labels
from coopsim.errors import RecordingError, UnknownNameError
from coopsim.metrics.log import GroundTruth
from coopsim.types import Detections, Ints


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
        RecordingError: it is not a recording set; the message says what is missing.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        labels, detections = self.path / "labels", self.path / "detections"
        for folder in (self.path, labels, detections):
            if not folder.is_dir():
                raise RecordingError(
                    f"no folder {folder}: a recording set has labels/<sequence>.txt and "
                    "detections/<name>/<sequence>.txt"
                )
        self.sequences = tuple(sorted(file.stem for file in labels.glob("*.txt")))
        self.detection_names = tuple(sorted(folder.name for folder in detections.iterdir() if folder.is_dir()))
        if not self.sequences:
            raise RecordingError(f"no label files: {labels} has no <sequence>.txt")

    def require_detections(self, names: Iterable[str]) -> None:
        """Raise unless there is a detection folder of each name."""
        for name in names:
            if name not in self.detection_names:
                raise UnknownNameError(f"detections in {self.path}", name, self.detection_names)

    def load(self, sequence: str, names: Sequence[str]) -> Recording:
        """Read one sequence with the detections called `names`.

        Raises:
            UnknownNameError: no such sequence or detections.
            RecordingError: a file is missing or broken; the message names file and line.
        """
        if sequence not in self.sequences:
            raise UnknownNameError(f"sequence in {self.path}", sequence, self.sequences)
        self.require_detections(names)
        truth_frame, truth_id, truth_boxes, truth_label, last = read_labels(self.path / "labels" / f"{sequence}.txt")
        found = {name: read_detections(self.path / "detections" / name / f"{sequence}.txt") for name in names}
        frames = 1 + max([last, *(int(frame.max(initial=-1)) for frame, *_ in found.values())])
        truth = [
            GroundTruth(truth_id[rows], truth_boxes[rows], truth_label[rows])
            for rows in _rows_by_frame(truth_frame, frames)
        ]
        detections = {}
        for name, (frame, boxes, score, label) in found.items():
            whole = Detections(boxes, score, label)
            detections[name] = [whole[rows] for rows in _rows_by_frame(frame, frames)]
        return Recording(frames, truth, detections)


def _rows_by_frame(frame: Ints, frames: int) -> list[Ints]:
    """The rows of each frame, in the file's order."""
    order = np.argsort(frame, kind="stable")
    bounds = np.searchsorted(frame[order], np.arange(frames + 1))
    return [order[start:end] for start, end in itertools.pairwise(bounds)]
