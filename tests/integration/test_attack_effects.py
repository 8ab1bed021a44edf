"""Effects of attacks on a receiver: what it tracks or detects with the lie, and where, against the same seed without.

Two connected cars drive; one lies. The effects are on objects that the other knows by its messages alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, ObjectClass
from coopsim.types.lies import Lie

LIAR, VICTIM, SEEDS = "cav_1", "cav_0", (0, 2, 6, 8, 12)
NEAR_M = 1.5
"""Distance on the ground within which something found is on an object; objects are farther apart."""

Array = np.ndarray[Any, Any]


@dataclass
class Frame:
    """A frame of the victim in the world frame: objects that only the liar sees, and what the victim reports."""

    told: Boxes3D
    velocity: Array
    boxes: Boxes3D
    label: Array
    speed: Array
    detections: Detections
    claimed: Boxes3D
    denied: Boxes3D


@cache
def play(
    attack: str | None, policy: str = "late_fusion", lidar: str | None = None, seeds: tuple[int, ...] = SEEDS
) -> list[Frame]:
    """Play a crossing with each seed, and return the second halves, in which tracks are confirmed."""
    return [frame for seed in seeds for frame in _play(attack, policy, lidar, seed)]


def _play(attack: str | None, policy: str, lidar: str | None, seed: int) -> list[Frame]:
    made = coopsim.make_policy(policy)
    options: dict[str, Any] = {
        "connected_cars": 2,
        "rsus": 0,
        "vehicles": 24,
        "lidar": lidar,
        "max_cycles": 16 if lidar is None else 8,
    }
    if lidar is not None:
        options["lidar_columns"] = 512
    attacks = None if attack is None else {LIAR: attack}
    env = coopsim.parallel_env("crossing", uplink=made, attacks=attacks, expose_ground_truth=True, **options)
    packed, infos = env.reset(seed=seed)
    made.reset(env.agent_specs, seed=seed)
    found = []
    while env.agents:
        lies, told = env.episode.lies, infos[VICTIM]
        actions = made.act(packed)
        detections = getattr(made, "detections", lambda agent: Detections.empty())(VICTIM)
        found.append(_frame(told, actions[VICTIM]["tracks"], detections, lies))
        packed, _, _, _, infos = env.step(actions)
    return found[len(found) // 2 :]


def _frame(told: Any, tracks: Any, detections: Detections, lies: tuple[Lie, ...]) -> Frame:
    place, truth = SE3.from_xyz_yaw(told["true_pose"][:3], float(told["true_pose"][3])), told["ground_truth"]
    alone = truth["counts"] & (truth["visible_to"] == 1)
    return Frame(
        Boxes3D.from_array(truth["box"][alone]).transform(place),
        np.nan_to_num(truth["velocity"][alone]) @ place.rotation[:2, :2].T,
        Boxes3D.from_array(tracks["box"]).transform(place),
        tracks["label"],
        np.hypot(*tracks["velocity"].T),
        detections.transform(place),
        Boxes3D.concatenate(lie.claimed for lie in lies),
        Boxes3D.concatenate(lie.denied for lie in lies),
    )


def distances(places: Array, boxes: Boxes3D) -> Array:
    """Return the distance (N,) of each place (N, 2) from the nearest box, on the ground."""
    apart = np.linalg.norm(places[:, None] - boxes.center[None, :, :2], axis=2)
    nearest: Array = apart.min(axis=1, initial=np.inf)
    return nearest


def at_their_places(frame: Frame) -> Array:
    return frame.told.center[:, :2]


def found(lied: list[Frame], places: Callable[[Frame], Array] = at_their_places) -> float:
    """Return the share of the objects that the victim tracks while all are honest, of which it tracks `places` now."""
    shares = []
    for before, now in zip(play(None), lied, strict=True):
        known = distances(at_their_places(before), before.boxes) <= NEAR_M
        shares.append(distances(places(now)[known], now.boxes) <= NEAR_M)
    assert sum(map(len, shares)) >= 50, "enough is told to judge"
    return float(np.concatenate(shares).mean())


def on_told(frame: Frame) -> Array:
    """Return the numbers of the victim's tracks on objects that it knows by messages alone."""
    return np.flatnonzero(distances(frame.boxes.center[:, :2], frame.told) <= NEAR_M)


def test_without_a_lie_the_objects_are_there() -> None:
    assert found(play(None)) == 1.0


def test_shifted_objects_are_tracked_beside_their_places() -> None:
    def beside(frame: Frame, left_m: float) -> Array:
        yaw = frame.told.yaw
        return at_their_places(frame) + left_m * np.column_stack([-np.sin(yaw), np.cos(yaw)])

    lied = play("shift(aside_m=4)")
    # The detector does not tell front from back, and where it takes one for the other, left is right.
    left, right = (found(lied, partial(beside, left_m=left_m)) for left_m in (4.0, -4.0))
    assert found(lied) < 0.2 and left + right > 0.8


def test_an_offset_of_the_pose_moves_all_that_a_sender_tells() -> None:
    lied = play("pose_offset(x_m=5)")
    assert found(lied) < 0.2 and found(lied, lambda frame: at_their_places(frame) + np.array([5.0, 0.0])) > 0.8


def test_removed_objects_are_gone() -> None:
    assert found(play("remove")) < 0.2


def test_relabelled_objects_are_tracked_as_another_class() -> None:
    def people(run: list[Frame]) -> float:
        return float(np.mean(np.concatenate([each.label[on_told(each)] == ObjectClass.PEDESTRIAN for each in run])))

    assert people(play("relabel(label=pedestrian)")) > 0.9 and people(play(None)) < 0.6
    assert found(play("relabel(label=pedestrian)")) > 0.8, "the places are honest"


def test_resized_objects_are_tracked_larger_at_their_places() -> None:
    def length_m(run: list[Frame]) -> float:
        return float(np.mean(np.concatenate([each.boxes.size[on_told(each), 0] for each in run])))

    lied = play("resize(factor=2)")
    assert length_m(lied) == pytest.approx(2 * length_m(play(None)), rel=0.15) and found(lied) > 0.8


def test_speeds_are_believed_where_messages_have_them() -> None:
    def speed_m_s(attack: str | None) -> float:
        return float(np.mean(np.concatenate([each.speed[on_told(each)] for each in play(attack, "track_to_track")])))

    assert speed_m_s("speed(factor=1, offset_m_s=10)") > speed_m_s(None) + 3


def test_an_older_stamp_moves_what_drives_and_leaves_what_stands() -> None:
    lied = play("stamp(offset_s=-0.5)")
    assert found(lied) < found(play(None)) - 0.1
    assert found(play("stamp(offset_s=0.5)")) > 0.8, "nothing is older than it is, so nothing is moved"


def test_a_replayed_message_tells_of_the_past_as_if_it_were_now() -> None:
    fresh, old = play("replay(delay_s=0.5)"), play("replay(delay_s=0.5, fresh=False)")
    assert found(fresh) < found(play(None)) - 0.3
    assert found(old) > found(fresh), "what says how old it is can be moved to now"


def test_a_model_in_the_points_is_detected_by_a_network() -> None:
    pytest.importorskip("torch")
    told: dict[str, Any] = {"policy": "early", "lidar": "HDL-32E", "seeds": SEEDS[:2]}
    honest, lied = play(None, **told), play("point_ghost(ahead_m=12)", **told)
    for before, now in zip(honest, lied, strict=True):
        (place,) = now.claimed.center[:, :2]
        assert distances(place[None], now.detections.boxes) <= 2.0 < distances(place[None], before.detections.boxes)


def test_objects_without_points_are_not_detected_by_a_network() -> None:
    pytest.importorskip("torch")
    told: dict[str, Any] = {"policy": "early", "lidar": "HDL-32E", "seeds": SEEDS[:2]}
    honest, lied = play(None, **told), play("point_removal", **told)
    lost = []
    for before, now in zip(honest, lied, strict=True):
        # A liar deletes what it detects itself, with errors, and so not all that it has points of.
        places = at_their_places(before)[distances(at_their_places(before), now.denied) <= NEAR_M]
        places = places[distances(places, before.detections.boxes) <= NEAR_M]
        lost.append(distances(places, now.detections.boxes) > NEAR_M)
    assert sum(map(len, lost)) >= 10 and np.concatenate(lost).mean() > 0.5, "most of them"
