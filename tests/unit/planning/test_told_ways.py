"""A told way takes the place of the prediction, for the track that it belongs to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import PlannedCar, make_planner
from coopsim.planning.told_ways import with_intents
from coopsim.types import Tracks
from coopsim.types.driving import Route
from coopsim.types.intents import Intents
from coopsim.types.taxonomy import ObjectClass

TIMES = np.array([0.0, 1.0, 3.0])


def tracks(*rows: tuple[float, float, float, float]) -> Tracks:
    """Cars at x, y with velocities vx, vy, which look where they go."""
    table = np.array(rows).reshape(-1, 4)
    heading = np.arctan2(table[:, 3], table[:, 2])
    size = np.tile([4.5, 1.9, 1.6], (len(table), 1))
    boxes = np.column_stack([table[:, :2], np.full(len(table), 0.8), size, heading])
    count = len(table)
    return Tracks(np.arange(count), Boxes3D.from_array(boxes), table[:, 2:], np.ones(count), np.zeros(count, np.int64))


def told(*ways: Floats, hard_brake: bool = False, **changes: Any) -> Intents:
    """Intents of senders 100, 101, ... with places (21, 3)."""
    count = len(ways)
    places = np.array(ways).reshape(count, 21, 3)
    speed = np.hypot(*(places[:, 1, :2] - places[:, 0, :2]).T) / 0.2
    sizes = np.full(count, 4.5), np.full(count, 1.9)
    return Intents(
        100 + np.arange(count), np.zeros(count), places, speed, *sizes, np.full(count, hard_brake), **changes
    )


def way(x: float, y: float, vx: float, vy: float, heading: float) -> Floats:
    step = 0.2 * np.arange(21)
    return np.column_stack([x + vx * step, y + vy * step, np.full(21, heading)])


def car(seen: Tracks, intents: Intents, speed: float = 10.0, right: int = 0) -> PlannedCar:
    along = np.arange(101.0)
    route = Route(np.column_stack([along, np.zeros(101)]), 1.0, np.full(101, 13.9), np.full(101, right))
    return PlannedCar("cav_0", 10**9, 0.1, seen, speed, 0.0, 0.0, 4.5, 1.9, route, intents=intents)


def test_the_nearest_track_takes_the_way_from_where_it_is() -> None:
    seen = tracks((20.0, 8.0, 0.0, -5.0), (40.0, 0.0, 3.0, 0.0))
    known, ways = with_intents(car(seen, told(way(20.6, 8.0, -10.0, 0.0, np.pi))), TIMES)
    assert known.tracks.id.tolist() == [0, 1] and ways.known.tolist() == [True, False]
    np.testing.assert_allclose(ways.places[:, 0, :2], [[20.0, 8.0], [10.0, 8.0], [-10.0, 8.0]])
    np.testing.assert_allclose(known.tracks.velocity, [[-10.0, 0.0], [3.0, 0.0]], atol=1e-9)


def test_a_sender_that_is_near_no_track_becomes_one() -> None:
    far, twin = way(60.0, 9.0, 0.0, -8.0, -np.pi / 2), way(20.5, 8.0, 0.0, 0.0, 0.0)
    intents = replace(told(twin, far, twin), length_m=np.array([4.5, np.nan, 4.5]))
    known, ways = with_intents(car(tracks((20.0, 8.0, 0.0, -5.0)), intents), TIMES)
    assert len(set(known.tracks.id.tolist())) == 3 and ways.known.all()  # the second of the two twins, too
    unseen = known.tracks[known.tracks.id == 2**40 + 101]
    np.testing.assert_allclose(unseen.boxes.array[0], [60.0, 9.0, 0.8, 12.0, 1.9, 1.6, -np.pi / 2])
    assert unseen.velocity[0].tolist() == pytest.approx([0.0, -8.0], abs=1e-9) and unseen.label[0] == ObjectClass.CAR


@pytest.mark.parametrize("name", ["idm_aeb", "route_follower"])
def test_a_planner_waits_for_nobody_who_tells_that_he_goes_elsewhere(name: str) -> None:
    """A car comes towards the route, and says that it stops before it; or it stands, and says that it comes."""
    comes, stands = tracks((28.0, 12.0, 0.0, -6.0)), tracks((28.0, 4.0, 0.0, 0.0))

    def acceleration(seen: Tracks, intents: Intents) -> float:
        planner = make_planner(name)
        planner.plan(replace(car(seen, intents), time_ns=0))
        for k in range(1, 7):  # long enough to believe the track
            plan = planner.plan(replace(car(seen, intents, right=-1), time_ns=k * 10**8))
        return plan if isinstance(plan, float) else plan[0]

    stops = way(28.0, 12.0, 0.0, 0.0, -np.pi / 2)
    assert (
        acceleration(comes, Intents.empty()) < acceleration(comes, told(stops)) and acceleration(comes, told(stops)) > 0
    )
    sets_off = way(28.0, 4.0, 0.0, -2.0, -np.pi / 2)
    assert acceleration(stands, Intents.empty()) > 0 > acceleration(stands, told(sets_off))


def test_who_warns_of_a_hard_brake_needs_no_second_alarm() -> None:
    ahead, stops = tracks((17.0, 0.0, 4.0, 0.0)), way(17.0, 0.0, 0.0, 0.0, 0.0)
    calm, warned = (make_planner("idm_aeb").plan(car(ahead, told(stops, hard_brake=each))) for each in (False, True))
    assert warned == -8.0 and isinstance(calm, float) and calm > -8.0


def test_without_intents_nothing_changes() -> None:
    seen = tracks((28.0, 12.0, 0.0, -6.0), (40.0, 0.0, 3.0, 0.0))
    far = told(way(900.0, 900.0, 0.0, 0.0, 0.0))
    assert make_planner("idm_aeb").plan(car(seen, Intents.empty())) == make_planner("idm_aeb").plan(car(seen, far))
