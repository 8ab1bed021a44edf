"""DrivingRows: the knowledge by which a car drives, as numbers in [-1, 1].

Frame: the agent's base frame now (x forward, y left, origin on the ground under the car's middle).

| key | shape | rows |
|---|---|---|
| `car` | (4,) | the car itself: `CAR_COLUMNS` |
| `route` | (points, 4) | places on its way ahead, evenly spaced up to `ahead_m`: `ROUTE_COLUMNS` |
| `tracks` | (tracks, 20) | the nearest tracks that its tracker reports: `REPORTED_COLUMNS` |
| `tracks_mask` | (tracks,) | 1 where a row has a track, 0 where it is padding (zeros) |

Each number is one in m, m/s or m/s² over its bound, and taken as the bound where it lies beyond. Tracks farther away
than `reach_m` along an axis are left out. A planner is given the same: tracks, the car's own motion, its route.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.wrappers.base_wrappers import cooperative_env
from coopsim.envs.wrappers.received import Arrays, Scene, View, reporter
from coopsim.envs.wrappers.track_rows import FASTEST_M_S, MOST_SIZE_M
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import PlannedCar
from coopsim.support.checks import require_count, require_positive
from coopsim.types import CLASS_NAMES, Tracks
from coopsim.types.driving import ACCELERATION, LARGEST_BRAKING_M_S2, STEERING, CarState, Route

CAR_COLUMNS = {
    "speed": FASTEST_M_S,
    "acceleration": LARGEST_BRAKING_M_S2,
    "length": float(MOST_SIZE_M[0]),
    "width": float(MOST_SIZE_M[1]),
}
"""Columns of a car, with their bounds in m, m/s and m/s²."""

ROUTE_COLUMNS = ("x", "y", "speed_limit", "right_of_way")
"""Place (over `ahead_m`), speed limit (over 40 m/s), and -1 to give way, 1 for priority, 0 for neither."""

REPORTED_COLUMNS = ("x", "y", "vx", "vy", "along", "aside", "cos_yaw", "sin_yaw", "l", "w", "score", *CLASS_NAMES)
"""Place (over `reach_m`); velocity over ground (over 40 m/s); distance along the route and to its left (over
`reach_m`); heading; length and width (over 20 m and 4 m); confidence; 1 in the column of its class."""


@dataclass(kw_only=True, eq=False)
class DrivingRowsView(View):
    """The car, its route and the nearest tracks. See the module for keys and columns.

    Attributes:
        tracks: number of tracks.
        points: number of places on the route.
        ahead_m: distance along the route of the last one.
        reach_m: largest x and y of tracks, in both directions.
    """

    tracks: int = 16
    points: int = 10
    ahead_m: float = 60.0
    reach_m: float = 80.0

    def __post_init__(self) -> None:
        require_count(1, tracks=self.tracks, points=self.points)
        require_positive(ahead_m=self.ahead_m, reach_m=self.reach_m)

    def require(self, env: Any) -> None:
        """Require drivers with a tracker; see `View.require`."""
        cooperative, within = cooperative_env(env), reporter(env)
        single = isinstance(env, gymnasium.Env)
        shown = [env.unwrapped.ego] if single else env.possible_agents
        tracked = within is not None and (not single or shown[0] in within.policies)
        specs = cooperative.agent_specs
        if not (tracked and all(specs[name].command in (ACCELERATION, STEERING) for name in shown)):
            how = "a tracker" if single else "be within Driving"
            drives = 'cars that control="acceleration" or "steering" drives'
            raise InvalidValueError(f"env must have {drives}, and {how}: got {env}")

    def spaces(self) -> dict[str, spaces.Box]:
        shapes = {
            "car": (len(CAR_COLUMNS),),
            "route": (self.points, len(ROUTE_COLUMNS)),
            "tracks": (self.tracks, len(REPORTED_COLUMNS)),
        }
        boxes: dict[str, spaces.Box] = {
            name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes.items()
        }
        return boxes | {"tracks_mask": spaces.Box(0.0, 1.0, (self.tracks,), np.float32)}

    def show(self, scene: Scene) -> Arrays:
        """Return new arrays, by name; see the module."""
        return self.rows(scene.car, scene.tracks)

    def rows(self, car: CarState | PlannedCar, tracks: Tracks) -> Arrays:
        """Return new arrays, by name, of a car and its tracks: so a planner can ask a network that learned on them."""
        rows = self._track_rows(tracks, car.route)
        table, mask = np.zeros((self.tracks, len(REPORTED_COLUMNS)), np.float32), np.zeros(self.tracks, np.float32)
        table[: len(rows)], mask[: len(rows)] = _clipped(rows), 1.0
        return {"car": _clipped(_car(car)), "route": self._route(car.route), "tracks": table, "tracks_mask": mask}

    def _route(self, route: Route) -> NDArray[np.float32]:
        """Return places on the route (points, 4); where it ends sooner, the last one again."""
        along = np.linspace(0.0, self.ahead_m, self.points) / route.spacing_m
        chosen = np.minimum(np.rint(along).astype(np.int64), len(route.points) - 1)
        limit, right = route.speed_limit_m_s[chosen] / FASTEST_M_S, route.right_of_way[chosen]
        return _clipped(np.column_stack([route.points[chosen] / self.ahead_m, limit, right]))

    def _track_rows(self, tracks: Tracks, route: Route) -> Floats:
        """Return the nearest tracks as rows of `REPORTED_COLUMNS`."""
        place = tracks.boxes.center[:, :2]
        within = np.flatnonzero((np.abs(place) <= self.reach_m).all(axis=1))
        first = within[np.argsort(np.hypot(*place[within].T), kind="stable")[: self.tracks]]
        along, aside, _ = route.place(place[first])
        yaw, size = tracks.boxes.yaw[first], tracks.boxes.size[first, :2]
        rows: Floats = np.column_stack(
            [
                place[first] / self.reach_m,
                tracks.velocity[first] / FASTEST_M_S,
                along / self.reach_m,
                aside / self.reach_m,
                np.cos(yaw),
                np.sin(yaw),
                size / MOST_SIZE_M[:2],
                tracks.score[first],
                np.eye(len(CLASS_NAMES))[tracks.label[first]],
            ]
        )
        return rows


def _car(car: CarState | PlannedCar) -> Floats:
    values = np.array([car.speed_m_s, car.acceleration_m_s2, car.length_m, car.width_m])
    shares: Floats = values / np.array(list(CAR_COLUMNS.values()))
    return shares


def _clipped(rows: Floats) -> NDArray[np.float32]:
    clipped: NDArray[np.float32] = np.clip(rows, -1.0, 1.0).astype(np.float32)
    return clipped
