"""Labelled objects of a frame: their classes, rows of boxes, and the upright frames in which they stand."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from coopsim.data.recordings.file_fields import Fields
from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.recordings.recorded_folder import RecordedObjects
from coopsim.types import Ints, Sweep
from coopsim.types.taxonomy import ObjectClass

_NAMES = {
    ObjectClass.CAR: (
        *("car", "policecar", "suv", "pickup", "pickuptruck", "taxi", "regularvehicle"),
        *("vehiclecar", "vehicleemergencypolice"),
    ),
    ObjectClass.VAN: ("van", "vehicleemergencyambulance"),
    ObjectClass.TRUCK: (
        *("truck", "boxtruck", "concretetruck", "semitruck", "semitrailer", "longvehicle", "trailer"),
        *("largevehicle", "truckcab", "vehiculartrailer"),
        *("vehicletruck", "vehicletrailer", "vehicleconstruction"),
    ),
    ObjectClass.BUS: ("bus", "schoolbus", "articulatedbus", "vehiclebusbendy", "vehiclebusrigid"),
    ObjectClass.MOTORCYCLE: (
        *("motorcycle", "motorcyclist", "motorcyclerider", "motorcylerider", "tricyclist", "vehiclemotorcycle"),
    ),
    ObjectClass.BICYCLE: ("bicycle", "bicyclerider", "bicyclist", "cyclist", "barrowlist", "vehiclebicycle"),
    ObjectClass.SCOOTER: ("scooter", "scooterrider", "wheeledrider", "humanpedestrianpersonalmobility"),
    ObjectClass.PEDESTRIAN: (
        *("pedestrian", "roadworker", "person", "personsitting", "officialsignaler"),
        *("humanpedestrianadult", "humanpedestrianpoliceofficer", "humanpedestrianconstructionworker"),
    ),
    ObjectClass.CHILD: ("child", "humanpedestrianchild"),
}
_CLASSES = {name: cls for cls, names in _NAMES.items() for name in names}
_NO_OBJECTS = (
    *("dontcare", "misc", "tram", "trafficcone", "trafficsign", "barrier", "trashcan", "unknown", "other"),
    # Argoverse 2
    *("animal", "dog", "bollard", "constructionbarrel", "constructioncone", "messageboardtrailer", "sign", "stopsign"),
    *("mobilepedestriancrossingsign", "railedvehicle", "stroller", "trafficlighttrailer", "wheelchair"),
    "wheeleddevice",
    # nuScenes
    *("humanpedestrianstroller", "humanpedestrianwheelchair", "movableobjectbarrier", "movableobjectdebris"),
    *("movableobjectpushablepullable", "movableobjecttrafficcone", "staticobjectbicyclerack"),
)
"""Types of labels that are no road users of ours, or not known."""


_IDS_OF_FRAME = 10_000  # more objects than any frame has


def ids_of_frame(number: int, count: int) -> Ints:
    """Return ids (N,) >= 1 of the objects of an unrelated frame, which no other frame has."""
    return _IDS_OF_FRAME * number + 1 + np.arange(count, dtype=np.int64)


def find_class(name: str) -> ObjectClass | None:
    """Return the class of a type's name, in which case and marks between words do not matter; None: it is no object.

    Raises:
        KeyError: the name is not known.
    """
    plain = "".join(letter for letter in name.lower() if letter.isalnum())
    return None if plain in _NO_OBJECTS else _CLASSES[plain]


def class_of(about: Fields, key: str, default: str | None = None) -> int | None:
    """Return the label of an object by the field with its type; None: it is no object of ours.

    Args:
        about: the object.
        key: name of the field.
        default: the type of objects without that field; None: it must be there.

    Raises:
        RecordingError: the field is missing, or the type is not known.
    """
    name = default if default is not None and key not in about else about.text(key)
    return class_named(name, f"{about.file}: {about.field(key)}")


def class_named(name: str, where: str) -> int | None:
    """Return the label of a type's name; None: it is no object of ours.

    Args:
        name: name of the type, see `find_class`.
        where: file and field, for the error.

    Raises:
        RecordingError: the type is not known.
    """
    try:
        found = find_class(name)
    except KeyError:
        accepted = ", ".join(sorted((*_CLASSES, *_NO_OBJECTS)))
        raise RecordingError(f"{where} must be the type of an object ({accepted}), got {name!r}") from None
    return None if found is None else int(found)


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


def base_under(world_SE3_sensor: SE3, height_m: float) -> SE3:
    """Return the upright frame on the ground under a sensor that is so high above it, x along the sensor's heading."""
    return SE3.from_xyz_yaw(world_SE3_sensor.translation - [0.0, 0.0, height_m], world_SE3_sensor.yaw)


def sweep_in_base(
    base_SE3_lidar: SE3, points: NDArray[np.float32], intensity: NDArray[np.float32] | None, full_scale: float = 1.0
) -> Sweep:
    """Return the points of a file as a sweep in the base frame.

    Args:
        base_SE3_lidar: pose of the LiDAR, with its tilt.
        points: (P, 3) m in the LiDAR's frame.
        intensity: (P,) in the file's own unit; None: there is none, and all are 0.
        full_scale: the intensity that counts as 1; larger ones do, too.
    """
    moved = points
    if not _is_identity(base_SE3_lidar):
        moved = base_SE3_lidar.apply(points).astype(np.float32)
    count = len(points)
    bright = np.zeros(count, np.float32) if intensity is None else np.clip(intensity / np.float32(full_scale), 0, 1)
    return Sweep(moved, bright, np.zeros(count, np.int64))


def _is_identity(pose: SE3) -> bool:
    return bool((pose.rotation == np.eye(3)).all() and not pose.translation.any())
