"""Whole routes: the ego drives to a goal through traffic that nobody has arranged, in drawn towns, on maps or logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from coopsim.support.checks import require_choice, require_count
from coopsim.world.drawn_places import choose_scenarios, find_drawer
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import EpisodeScenarios, Scenario
from coopsim.world.situations.situation import NAMED, SITUATIONS, Situation, Stage

_WISHES: Mapping[str, Any] = {"junctions": 6, "radius_m": 400.0, "traffic_lights": True}
"""Options of drawn places, as far as they have them: room for a route, and lights."""

_FIXED: Mapping[str, int] = {"vans": 0, "buses": 0, "motorcycles": 0, "children": 0, "scooters": 0, "bicycles": 4}
_TRUCK_SHARE = 0.1


@SITUATIONS.register("route")
@dataclass(frozen=True, kw_only=True, eq=False)
class RouteDrive(Situation):
    """A drive along a route; the option `route_m` bounds its length, and the planner must steer.

    Attributes:
        vehicles: cars and trucks, the ego among them.
        pedestrians: people on foot.
        parked: vehicles at the kerb, in drawn towns and on maps.
        routes: file of CARLA's routes for a `place` that is a map, see `MapOptions`; None: routes are drawn.
    """

    vehicles: int = 40
    pedestrians: int = 20
    parked: int = 24
    routes: str | None = None
    over_s: float = 180.0

    _made: dict[Any, EpisodeScenarios] = field(default_factory=dict, init=False, repr=False)

    name = "route"
    named: ClassVar[str] = "urban_grid"
    calibrated: ClassVar[bool] = False
    usual: ClassVar[Mapping[str, Any]] = {
        "planner": "route_follower",
        "route_m": (300.0, 1000.0),
        "ends_on_arrival": True,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, self.most_actors, vehicles=self.vehicles)
        require_count(0, self.most_actors, pedestrians=self.pedestrians, parked=self.parked)

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""
        place = next(self.order(seed))
        if place not in self._made:
            self._made[place] = self._in(place)
        return self._made[place].of(seed)

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Return None: a route has no script."""
        return None

    def _in(self, place: Any) -> EpisodeScenarios:
        """Return the scenarios in drawings of a place, whose agents are the same everywhere."""
        cars = self.vehicles - round(_TRUCK_SHARE * self.vehicles)
        found = self.built_in if place == NAMED else place
        drawer = find_drawer(found)
        numbers: dict[str, Any] = {
            "vehicles": self.vehicles,
            "truck_share": _TRUCK_SHARE,
            "pedestrians": self.pedestrians,
            "parked": 0 if drawer is None else self.parked,
            "connected_cars": 1 + round(self.penetration * (cars - 1)),
            "rsus": self.rsus,
            "drones": 0,
            **_FIXED,
        }
        known = {} if drawer is None else {each.name for kind in drawer.kinds for each in fields(kind)}
        wishes: dict[str, Any] = {"place_seed": self.place_seed, **_WISHES}
        if self.routes is not None:
            require_choice("option of this place", "routes", known)
            wishes["routes"] = self.routes
        numbers |= {name: value for name, value in wishes.items() if name in known}
        return choose_scenarios(found, detail=self.detail, drawer=drawer, **numbers)
