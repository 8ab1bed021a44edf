"""Numbers that stand in messages and files never change, and superclasses are those of the papers."""

from coopsim.types.taxonomy import CLASS_NAMES, SUPERCLASS_NUMBERS, ObjectClass, Superclass


def test_labels_keep_their_numbers() -> None:
    assert CLASS_NAMES == (
        "car",
        "van",
        "truck",
        "bus",
        "motorcycle",
        "bicycle",
        "scooter",
        "pedestrian",
        "child",
    )
    assert list(ObjectClass) == list(range(9))


def test_superclasses_are_those_of_table_i() -> None:
    named = {each.title: [cls.title for cls in each.classes] for each in Superclass}
    assert named == {
        "Vehicle": ["car"],
        "Pedestrian": ["motorcycle", "bicycle", "scooter", "pedestrian", "child"],
        "Truck": ["van", "truck", "bus"],
    }


def test_numbers_are_equal_within_a_superclass_only() -> None:
    for a in ObjectClass:
        for b in ObjectClass:
            assert (SUPERCLASS_NUMBERS[a] == SUPERCLASS_NUMBERS[b]) == (a.superclass is b.superclass)
