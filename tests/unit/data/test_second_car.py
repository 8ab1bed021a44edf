"""The place of a second car is found from the boxes of both cars, in the first one's frame."""

import numpy as np

from coopsim.data.recording_set import Recording
from coopsim.data.second_car import SecondCar, find_second_car
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.rng import stream
from coopsim.types import Detections, GroundTruth, Ints

FRAMES = 40
NAMES = ("ego", "1")


def boxes(places: np.ndarray, yaw: float = 0.0) -> Boxes3D:
    """Return cars at places (N, 2)."""
    count = len(places)
    return Boxes3D(
        np.column_stack([places, np.zeros(count)]), np.tile([4.5, 1.9, 1.6], (count, 1)), np.full(count, yaw)
    )


def detections(places: np.ndarray) -> Detections:
    """Return detections of cars."""
    return Detections(boxes(places), np.full(len(places), 0.5), np.zeros(len(places), np.int64))


def recorded(labelled: range, boxed: range, pose: np.ndarray) -> tuple[Recording, np.ndarray]:
    """Return a recording of two cars that meet parked ones, and the second one's true place (F, 2).

    The second car has the id 5 where it is labelled. Both cars find all parked ones within 70 m.
    """
    rng, truth = stream(5, "boxes"), []
    parked = rng.uniform([-90.0, -30.0], [90.0, 30.0], (40, 2))
    found: dict[str, list[Detections]] = {name: [] for name in NAMES}
    at = np.column_stack([np.linspace(30.0, 44.0, FRAMES), np.full(FRAMES, -4.0)])
    parked = parked[np.hypot(*(parked[:, None] - at).transpose(2, 0, 1)).min(axis=1) > 6.0]
    for k in range(FRAMES):
        cos, sin = np.cos(pose[k, 2]), np.sin(pose[k, 2])
        turn = np.array([[cos, -sin], [sin, cos]])  # from the right: places of the world's directions in the car's
        mine, theirs = (np.hypot(*(parked - place).T) < 70.0 for place in (np.zeros(2), at[k]))
        seen = [parked[mine], *([at[k : k + 1]] if k in boxed else [])]
        labels = [parked, *([at[k : k + 1]] if k in labelled else [])]
        ids = np.concatenate([np.arange(10, 10 + len(parked)), [5]])[: sum(map(len, labels))]
        places = np.concatenate(labels) @ turn
        truth.append(GroundTruth(ids, boxes(places, 0.1 - pose[k, 2]), np.zeros(len(ids), np.int64)))
        found["ego"].append(detections(np.concatenate(seen) @ turn))
        found["1"].append(detections(np.concatenate([parked[theirs], at[k] + rng.uniform(20, 50, (1, 2))]) @ turn))
    return Recording(FRAMES, truth, found), at


def found_in(labelled: range, boxed: range, turn_rad: float = 0.0) -> tuple[SecondCar, np.ndarray, Ints]:
    """Return the second car, how far off it is placed (F,), and the frames."""
    pose = np.column_stack([np.zeros((FRAMES, 2)), np.linspace(0.0, turn_rad, FRAMES)])
    recording, at = recorded(labelled, boxed, pose)
    second = find_second_car(recording, NAMES, pose)
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    true = np.column_stack([cos * at[:, 0] + sin * at[:, 1], cos * at[:, 1] - sin * at[:, 0]])
    return second, np.hypot(*(second.place - true).T), np.arange(FRAMES)


def test_a_labelled_car_is_where_its_label_is() -> None:
    second, off_m, _ = found_in(range(FRAMES), range(FRAMES))
    assert (second.label == 5).all() and not second.boxed.any()
    assert off_m.max() < 1e-9
    assert np.abs(second.heading - 0.1).max() < 1e-9


def test_boxes_and_time_say_the_place_where_labels_do_not() -> None:
    second, off_m, frame = found_in(range(20), range(34))
    assert (second.label[:20] == 5).all() and second.boxed[20:34].all() and not second.boxed[34:].any()
    assert off_m[:34].max() < 1e-9
    assert off_m[34:].max() < 4.0, "unseen, it is within two cells"
    assert np.abs(second.heading[frame] - 0.1).max() < 1e-9, "a heading is kept while there is no label"


def test_a_turn_of_the_first_car_does_not_lose_it() -> None:
    second, off_m, _ = found_in(range(FRAMES), range(FRAMES), turn_rad=2.0)
    assert (second.label == 5).all()
    assert off_m.max() < 1e-9


def test_a_car_that_nobody_saw_is_in_the_middle_of_its_boxes() -> None:
    second, _, _ = found_in(range(0), range(0))
    assert (second.label == -1).all() and not second.boxed.any()
    assert second.score < 0.55
    assert np.ptp(second.place[:, 0]) < 20.0 and (second.place[:, 0] > 0.0).all()
