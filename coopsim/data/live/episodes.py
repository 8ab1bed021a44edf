"""Episodes in which SUMO drives: which of its cars are connected, and when they are over."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coopsim.data.live.engine import SumoEngine, SumoRun, step_for
from coopsim.data.live.sumo_world import MOST_SHOWN, SumoWorld
from coopsim.data.logs.filling import Columns, make_log
from coopsim.data.logs.play.choice import Wish, choose
from coopsim.data.logs.track_log import TrackLog
from coopsim.errors import CoopsimError
from coopsim.support.checks import require_choice
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import EpisodeScenarios, Scenario
from coopsim.world.snapshot import WorldSource

CONTROLS = ("traffic", "acceleration", "planner")
WARM_S = 60.0
"""Least time from the first departure to an episode."""


@dataclass(frozen=True, slots=True, eq=False)
class LivePart:
    """SUMO as an episode's traffic; see `coopsim.world.scenario.Played`."""

    engine: SumoEngine
    run: SumoRun
    start_s: float
    cars: Sequence[str]
    middle: np.ndarray
    radius_m: float
    _worlds: list[SumoWorld] = field(default_factory=list)

    @property
    def over_s(self) -> float:
        """Time at which the first connected car left; infinite as long as all are there."""
        left_s = self._worlds[-1].left_s if self._worlds else None
        return np.inf if left_s is None else left_s

    @property
    def facts(self) -> Mapping[str, Any]:
        """SUMO's time at which the episode begins, and its names of the connected cars."""
        return {"sumo_start_s": self.start_s, "sumo_cars": list(self.cars)}

    def world(
        self, scenario: Scenario, seed: int, *, control: str = "traffic", driven: Sequence[str] | None = None
    ) -> WorldSource:
        """Return the world, for which SUMO begins anew; cars without a command are SUMO's.

        Raises:
            UnknownNameError: cars cannot be driven so, or there is no car of a name.
        """
        require_choice("control of cars in traffic of SUMO", control, CONTROLS)
        for name in driven or ():
            require_choice("connected car in driven_agents", name, [f"cav_{k}" for k in range(len(self.cars))])
        self.engine.start(self.run)
        self.engine.go_on(self.start_s)
        made = SumoWorld(self.engine, self.run.step_s, self.cars, scenario, self.middle, self.radius_m, seed)
        self._worlds[:] = [made]
        return made


class SumoScenarios(EpisodeScenarios):
    """Scenarios in which SUMO drives."""

    most_actors = MOST_SHOWN

    def __init__(self, seeds: PlaceSeeds, dt_s: float) -> None:
        self._seeds, self._dt_s, self._step_s = seeds, dt_s, step_for(dt_s)
        self._engine = SumoEngine()
        self._last: tuple[int, Scenario] | None = None

    @abstractmethod
    def _made(self, seed: int) -> Scenario:
        """Return the scenario of an episode."""

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""
        if self._last is None or self._last[0] != seed:
            try:
                self._last = seed, self._made(seed)
            except CoopsimError:  # the traceback keeps all this, and with it SUMO
                self.close()
                raise
        return self._last[1]

    def close(self) -> None:
        """Let other environments have SUMO."""
        self._engine.close()

    def _part(self, run: SumoRun, log: TrackLog, wish: Wish, seed: int) -> LivePart:
        """Choose the connected cars and the place by what SUMO will do if it drives them.

        Raises:
            InvalidValueError: there are not so many cars for so long.
        """
        choice = choose(log, wish, seed)
        names = [choice.log.ids[k] for k in choice.connected]
        return LivePart(self._engine, run, choice.start_s, names, choice.middle, wish.radius_m)

    def _look_ahead(self, run: SumoRun, wish: Wish) -> TrackLog:
        """Return what SUMO does for the time of a wish if it drives all."""
        assert wish.start_s is not None, "it was drawn"
        self._engine.start(run)
        times_s = (wish.start_s + self._dt_s * np.arange(np.ceil(wish.least_s / self._dt_s - 1e-9) + 1)).round(3)
        moments = []
        for time_s in times_s.tolist():
            self._engine.go_on(time_s)
            moments.append(self._engine.users())
        kind = np.concatenate([each.kind for each in moments])
        columns = Columns(
            time_s=np.repeat(times_s, [len(each.names) for each in moments]),
            id=np.array([name for each in moments for name in each.names]),
            label=self._engine.label[kind],
            xy=np.concatenate([each.place for each in moments]),
            heading=np.concatenate([each.heading for each in moments]),
            velocity=np.concatenate([each.velocity for each in moments]),
            size=self._engine.size[kind],
            step_s=self._dt_s,
        )
        return make_log("SUMO's traffic", "sumo", columns)


def scenario_of(
    name: str, layout: Layout, population: Population, detail: str, place_seed: int, part: LivePart
) -> Scenario:
    """Return a scenario with the agents of a population, and no other road users than SUMO's."""
    agents = {each: getattr(population, each) for each in ("rsus", "drones")}
    cars = population.connected
    there = Population(vehicles=cars, truck_share=0.0, connected_cars=cars, pedestrians=0, **agents)
    return Scenario(name, layout, there, detail, place_seed=place_seed, played=part)
