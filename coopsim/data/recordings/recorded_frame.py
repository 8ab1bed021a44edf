"""One frame of a recording: what each agent sensed, where it was, and the labelled objects around."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from coopsim.data.recordings.recorded_picture import RecordedPicture
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Ints, Sweep


@dataclass(frozen=True, slots=True)
class RecordedName:
    """The name of an agent in a recording, and what it is.

    Attributes:
        recorded: its name there, as "641".
        kind: "cav", "rsu" or "drone".
    """

    recorded: str
    kind: Literal["cav", "rsu", "drone"]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedObjects:
    """N labelled objects.

    Attributes:
        id: (N,) >= 1, unique, and constant over a sequence.
        boxes: upright boxes in the world frame.
        label: (N,) an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    label: Ints

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedAgent:
    """One agent in one frame.

    Attributes:
        world_SE3_base: its pose, upright: x along its heading, on the ground under it.
        base_SE3_lidar: pose of its LiDAR, with the tilt that it has in this frame.
        read_sweep: returns its points in the base frame; reads a file at each call.
        find_pictures: returns its pictures, by camera; looks for files at each call.
        object_id: its own id among the objects; None: not known, or it is no object.
    """

    world_SE3_base: SE3
    base_SE3_lidar: SE3
    read_sweep: Callable[[], Sweep]
    find_pictures: Callable[[], Mapping[str, RecordedPicture]] = dict
    object_id: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrame:
    """All agents at one moment, and the union of the objects that were labelled for any of them.

    Attributes:
        time_ns: since the sequence's first frame.
        agents: by coopsim's names, as "cav_0".
        objects: the labels.
    """

    time_ns: int
    agents: Mapping[str, RecordedAgent]
    objects: RecordedObjects
