"""The path of a car is recovered from boxes in its own frame, of which some stand."""

from pathlib import Path

import numpy as np
import pytest
from detector_matches import AGENTS
from measure_twin import seconds_apart
from twin_worlds import TwinWorld

from coopsim.data.recorded_path import RecordedPath, Sightings, chained, in_world, recover_path, residuals_of
from coopsim.data.recording_set import RecordingSet
from coopsim.support.rng import stream

FRAMES = 120


def driven() -> np.ndarray:
    """Return poses (F, 3): 10 m/s, a bend to the left of 40 degrees, and a stop."""
    speed = np.interp(np.arange(FRAMES), [0, 70, 110], [1.0, 1.0, 0.0])
    turn = np.where((np.arange(FRAMES) > 20) & (np.arange(FRAMES) < 60), np.radians(1.0), 0.0)
    steps = np.column_stack([speed, np.zeros(FRAMES), turn])
    steps[0] = 0.0
    return chained(steps)


def sighted(pose: np.ndarray, standing: int, jitter_m: float = 0.0) -> Sightings:
    """Return what the car sees of standing objects along its way, and of three that drive before it."""
    rng = stream(3, "boxes")
    along = np.linspace(0.0, 90.0, standing)
    still = np.column_stack([along, rng.uniform(-25.0, 40.0, standing)])
    frames = np.arange(FRAMES)
    rows = [(np.full(FRAMES, k), frames, np.tile(place, (FRAMES, 1))) for k, place in enumerate(still)]
    for k, ahead in enumerate((12.0, 20.0, 35.0)):
        rows.append((np.full(FRAMES, 100 + k), frames, in_world(np.tile([ahead, k * 3.5 - 3.5], (FRAMES, 1)), pose)))
    name, frame, place = (np.concatenate(part) for part in zip(*rows, strict=True))
    seen = in_world(place - pose[frame, :2], np.column_stack([np.zeros((len(frame), 2)), -pose[frame, 2]]))
    near = np.hypot(*seen.T) < 60.0
    return Sightings(frame[near], name[near], seen[near] + jitter_m * rng.standard_normal((near.sum(), 2)))


def rough(pose: np.ndarray) -> np.ndarray:
    """Return estimates of the motions of a path, off by 0.3 m/s and 2 degrees a second."""
    steps = np.diff(pose, axis=0, prepend=pose[:1])
    ahead = np.concatenate([[0.0], np.hypot(*steps[1:, :2].T)])
    off = stream(1, "odometry").standard_normal((FRAMES, 2)) * [0.03, np.radians(0.2)]
    found = np.column_stack([ahead + off[:, 0], np.zeros(FRAMES), steps[:, 2] + off[:, 1]])
    found[0] = 0.0
    return found


def recovered(standing: int, jitter_m: float = 0.0) -> tuple[np.ndarray, RecordedPath, Sightings]:
    """Return the true path, the recovered one, and what it was recovered from."""
    pose = driven()
    seen = sighted(pose, standing, jitter_m)
    return pose, recover_path(seen, rough(pose)), seen


def test_path_is_recovered_to_a_centimetre() -> None:
    pose, found, seen = recovered(standing=8)
    off = found.pose - pose
    assert np.hypot(*off[:, :2].T).max() < 0.01
    assert np.degrees(np.abs(off[:, 2])).max() < 0.1
    assert np.nanmax(np.abs(found.residual_m)) < 0.05
    driving = pose[seen.frame[found.standing], 0] < pose[100, 0]
    assert (seen.object[found.standing][driving] < 100).all(), "cars that drive do not stand"


def test_chained_estimates_alone_are_metres_off() -> None:
    pose = driven()
    assert np.hypot(*(chained(rough(pose)) - pose)[-1, :2]) > 0.2


def test_jitter_of_labels_is_averaged() -> None:
    pose, found, _ = recovered(standing=12, jitter_m=0.05)
    assert np.hypot(*(found.pose - pose)[:, :2].T).max() < 0.15
    assert np.nanmedian(np.abs(found.residual_m)) / 0.6745 == pytest.approx(0.05, abs=0.015)


def test_where_nothing_stands_the_first_estimates_remain() -> None:
    pose = driven()
    steps = rough(pose)
    found = recover_path(sighted(pose, standing=0), steps)
    gone = np.hypot(*np.diff(found.pose[:, :2], axis=0).T)
    assert np.abs(gone[:70] - 1.0).mean() < 0.05, "cars that go alike are not taken for standing ones"


def test_objects_left_out_lie_where_they_stood() -> None:
    pose = driven()
    seen = sighted(pose, standing=12)
    one, two = (
        Sightings(seen.frame[k], seen.object[k], seen.place[k]) for k in (seen.object % 2 == 0, seen.object % 2 == 1)
    )
    path = recover_path(one, rough(pose))
    standing, residual_m = residuals_of(two, path.pose)
    assert standing.any() and np.nanmax(np.abs(residual_m)) < 0.1


def test_labels_of_v2v4real_lie_within_centimetres_in_the_recovered_world(v2v4real: Path) -> None:
    world = TwinWorld.of(RecordingSet(v2v4real, "v2v4real").load("0003", AGENTS))
    (one, over_one), (two, over_two) = world.halves()
    over_m = np.concatenate([over_one, over_two])
    over_m = over_m[np.isfinite(over_m[:, 0])]
    assert len(over_m) > 500
    assert np.median(np.abs(over_m)) < 0.05, "objects by which the path was not recovered lie where they stood"
    apart_m, apart_rad = seconds_apart(one.pose, two.pose)
    assert apart_m < 0.3 and apart_rad < 0.01, "both halves of the objects say where the car is a second later"
    assert np.mean(world.second.label == 39) > 0.9
