"""Object classes in the fixed order of labels, their superclasses, and checks of objects' labels and ids."""

from __future__ import annotations

from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.support.arrays import Floats, Ints
from coopsim.support.kernels import njit


class ObjectClass(IntEnum):
    """Nine classes after V2X-Real (Xiang et al. 2024), as used by DINO-CoDT (He et al., Table I).

    The data set has more classes (a police car is no car, a scooter not its rider); here a rider and the ridden vehicle
    are one object of the vehicle's class.
    """

    CAR = 0
    VAN = 1
    TRUCK = 2
    BUS = 3
    MOTORCYCLE = 4
    BICYCLE = 5
    SCOOTER = 6
    PEDESTRIAN = 7
    CHILD = 8

    @property
    def title(self) -> str:
        """The class's name in lower case, as it stands in tables and files."""
        return self.name.lower()

    @property
    def superclass(self) -> Superclass:
        """The superclass of the class."""
        return _SUPERCLASS[self]


class Superclass(Enum):
    """The superclasses of DINO-CoDT's Table I, which are V2X-Real's: classes are grouped by the size of their boxes."""

    VEHICLE = "Vehicle"
    PEDESTRIAN = "Pedestrian"
    TRUCK = "Truck"

    @property
    def title(self) -> str:
        """The name as in the papers: capitals distinguish the superclass Truck from the class truck."""
        return self.value

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """The classes that belong to it."""
        return tuple(cls for cls in ObjectClass if cls.superclass is self)


_SUPERCLASS = {
    ObjectClass.CAR: Superclass.VEHICLE,
    ObjectClass.VAN: Superclass.TRUCK,
    ObjectClass.TRUCK: Superclass.TRUCK,
    ObjectClass.BUS: Superclass.TRUCK,
    ObjectClass.MOTORCYCLE: Superclass.PEDESTRIAN,
    ObjectClass.BICYCLE: Superclass.PEDESTRIAN,
    ObjectClass.SCOOTER: Superclass.PEDESTRIAN,
    ObjectClass.PEDESTRIAN: Superclass.PEDESTRIAN,
    ObjectClass.CHILD: Superclass.PEDESTRIAN,
}

SUPERCLASS_NUMBERS: tuple[int, ...] = tuple(list(Superclass).index(cls.superclass) for cls in ObjectClass)
"""By label: labels of one superclass have the same number."""

CLASS_NAMES: tuple[str, ...] = tuple(cls.title for cls in ObjectClass)
"""Names by label: `CLASS_NAMES[label]`."""


def require_identified(ids: NDArray[np.int64], label: NDArray[np.int64], what: str) -> None:
    """Raise `InvalidValueError` unless the ids (N,) of one frame's objects are unique, and their labels classes."""
    ordered = np.sort(ids)
    again = ordered[1:] == ordered[:-1]
    if again.any():
        twice = np.unique(ordered[1:][again]).tolist()
        raise InvalidValueError(f"{what} ids must be unique within a frame, got {twice} more than once")
    require_classes(label, what)


def require_classes(label: NDArray[np.int64], what: str) -> None:
    """Raise `InvalidValueError` unless all labels (N,) are those of an `ObjectClass`."""
    if len(label) and not (label.min() >= 0 and label.max() < len(CLASS_NAMES)):
        wrong = sorted(set(label.tolist()) - set(range(len(CLASS_NAMES))))
        raise InvalidValueError(f"{what} labels must be in 0..{len(CLASS_NAMES) - 1}, got {wrong}")


@njit(cache=True, nogil=True)
def are_sound(boxes: Floats, ids: Ints, label: Ints, classes: int) -> bool:
    """Return whether boxes (N, 7) are finite and have sizes > 0, ids (N,) are unique, and labels (N,) below `classes`.

    All arrays are contiguous, and `ids` and `label` read-only: one layout, compiled once.
    """
    for i in range(len(boxes)):
        for j in range(7):
            if not np.isfinite(boxes[i, j]):
                return False
        if boxes[i, 3] <= 0 or boxes[i, 4] <= 0 or boxes[i, 5] <= 0:
            return False
        if label[i] < 0 or label[i] >= classes:
            return False
    ordered = np.sort(ids)
    for i in range(1, len(ordered)):  # noqa: SIM110  (numba takes no generator)
        if ordered[i] == ordered[i - 1]:
            return False
    return True
