"""Names of object classes in data sets, and the classes of ours that they are."""

from __future__ import annotations

from coopsim.data.recordings.file_fields import Fields
from coopsim.types.taxonomy import ObjectClass

_NAMES = {
    ObjectClass.CAR: ("car", "policecar", "suv", "pickup", "pickuptruck", "taxi"),
    ObjectClass.VAN: ("van",),
    ObjectClass.TRUCK: ("truck", "boxtruck", "concretetruck", "semitruck", "semitrailer", "longvehicle", "trailer"),
    ObjectClass.BUS: ("bus",),
    ObjectClass.MOTORCYCLE: ("motorcycle", "motorcyclist", "motorcyclerider", "motorcylerider", "tricyclist"),
    ObjectClass.BICYCLE: ("bicycle", "bicyclerider", "cyclist", "barrowlist"),
    ObjectClass.SCOOTER: ("scooter", "scooterrider"),
    ObjectClass.PEDESTRIAN: ("pedestrian", "roadworker", "person", "personsitting"),
    ObjectClass.CHILD: ("child",),
}
_CLASSES = {name: cls for cls, names in _NAMES.items() for name in names}
_NO_OBJECTS = ("dontcare", "misc", "tram", "trafficcone", "trafficsign", "barrier", "trashcan", "unknown", "other")
"""Types of labels that are no road users of ours, or not known."""


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
    try:
        found = find_class(name)
    except KeyError:
        accepted = ", ".join(sorted((*_CLASSES, *_NO_OBJECTS)))
        raise about.error(key, f"must be the type of an object ({accepted}), got {name!r}") from None
    return None if found is None else int(found)
