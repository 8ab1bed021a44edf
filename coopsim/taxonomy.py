"""Object classes, in the fixed order in which labels are numbered everywhere."""

from __future__ import annotations

from enum import IntEnum


class ObjectClass(IntEnum):
    """The nine classes of V2X-Real (Xiang et al. 2024), as used by DINO-CoDT, Table I."""

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


CLASS_NAMES: tuple[str, ...] = tuple(cls.title for cls in ObjectClass)
"""Names by label: `CLASS_NAMES[label]`."""
