"""Objects of a frame, collected one label after the other."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from coopsim.data.recordings.recorded_frame import RecordedObjects
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.types import Ints


class LabelledRows:
    """A list of labelled boxes that grows."""

    def __init__(self) -> None:
        self._ids: list[int] = []
        self._rows: list[list[float]] = []
        self._labels: list[int] = []

    def add(self, object_id: int, middle: Floats, size: Floats, yaw_rad: float, label: int) -> None:
        """Add a box: its middle (3,) m, length, width and height (3,) m and heading."""
        self._ids.append(object_id)
        self._rows.append([*middle.tolist(), *size.tolist(), yaw_rad])
        self._labels.append(label)

    def objects(self, world_SE3_file: SE3 | None = None) -> RecordedObjects:
        """Return the objects in the world frame.

        Args:
            world_SE3_file: pose of the frame that the boxes are in, which may tilt; boxes stay upright. None: it is the
                world's.
        """
        rows = np.array(self._rows, np.float64).reshape(-1, 7)
        ids, labels = np.array(self._ids, np.int64), np.array(self._labels, np.int64)
        if world_SE3_file is not None:
            rows[:, 6] = headings_in(world_SE3_file, rows[:, 6])
            rows[:, :3] = world_SE3_file.apply(rows[:, :3])
        rows[:, 6] = wrap_angle(rows[:, 6])
        return RecordedObjects(ids, Boxes3D.from_array(rows), labels)


def headings_in(world_SE3_file: SE3, yaw_rad: Floats) -> Floats:
    """Return the headings (N,) in the world of boxes that are turned about z of a frame that tilts."""
    along = world_SE3_file.rotate(np.column_stack([np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(len(yaw_rad))]))
    heading: Floats = np.arctan2(along[:, 1], along[:, 0])
    return heading


def join_objects(parts: Iterable[RecordedObjects]) -> RecordedObjects:
    """Return the union of what several agents list; of an object that several list, the first one's label."""
    whole = list(parts)
    ids: Ints = np.concatenate([np.zeros(0, np.int64), *(part.id for part in whole)])
    kept = np.sort(np.unique(ids, return_index=True)[1])
    boxes = Boxes3D.concatenate(part.boxes for part in whole)
    labels = np.concatenate([np.zeros(0, np.int64), *(part.label for part in whole)])
    return RecordedObjects(ids[kept], boxes[kept], labels[kept])
