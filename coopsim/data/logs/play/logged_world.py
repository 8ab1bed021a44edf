"""The world of an episode that follows a log."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.data.logs.play.shapes import fitted_models
from coopsim.data.logs.track_log import Moment, TrackLog
from coopsim.geometry import exact
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.rng import uniform_numbers
from coopsim.types import Ints
from coopsim.types.driving import Command
from coopsim.world.models.paint import draw_colors
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody, StaticPart


class LoggedWorld:
    """Road users at the places where a log has them; see `WorldSource`.

    Args:
        log: the part that is played, in the world's frame.
        start_s: time in the log at which the episode begins.
        connected: tracks of the connected cars, in the agents' order.
        scenario: the surroundings, roadside units and drones.
        seed: the episode's: models and colours.
    """

    def __init__(self, log: TrackLog, start_s: float, connected: Ints, scenario: Scenario, seed: int) -> None:
        self._log, self._start_s, self._connected, self._seed = log, start_s, connected, seed
        self.models, self._model = fitted_models(log.label, log.size, scenario.models, seed)
        self.static: tuple[StaticPart, ...] = scenario.static
        self.map = scenario.layout.road_map
        self._layout, self._population = scenario.layout, scenario.population
        ids = np.arange(1, len(log.ids) + 1)
        self._colors = draw_colors(seed, ids, log.label, dirty=scenario.detail != "plain")
        self._phase = uniform_numbers(seed, "phase", ids, 1)[:, 0]
        self._cycle_m = np.array([model.cycle_m for model in self.models])[self._model]
        self._size = np.array([model.size_m for model in self.models])[self._model]
        self._travelled_m = np.zeros(len(ids))
        self._time_s = 0.0
        self._now = log.at(start_s)

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Go on by `dt_s`; commands have no effect on a log."""
        self._time_s = round(self._time_s + dt_s, 9)
        self._now = self._log.at(self._start_s + self._time_s)
        self._travelled_m[self._now.track] += dt_s * exact.norm(self._now.velocity)

    def actors(self) -> Actors:
        """Return the road users of this moment."""
        now, track = self._now, self._now.track
        size = self._size[track]
        middle = self._on_ground(now.place)
        middle[:, 2] += size[:, 2] / 2
        first, second = self._colors
        phase = np.mod(self._travelled_m / self._cycle_m + self._phase, 1.0)
        return Actors.trusted(
            Boxes3D.trusted(middle, size, now.heading.copy()),
            id=track + 1,
            velocity=now.velocity.copy(),
            label=self._log.label[track],
            model=self._model[track],
            color=first[track],
            accent=second[track],
            phase=phase[track],
        )

    def agents(self) -> dict[str, AgentBody]:
        """Return connected cars, then roadside units, then drones."""
        bodies: dict[str, AgentBody] = {}
        for k, track in enumerate(self._connected.tolist()):
            pose = self._pose(self._now, track)
            height_m = float(self._size[track, 2])
            bodies[f"cav_{k}"] = AgentBody(f"cav_{k}", "cav", track + 1, pose, height_m)
        population = self._population
        return bodies | self._layout.posts(population.rsus, population.drones, self._time_s)

    def _pose(self, now: Moment, track: int) -> SE3:
        row = int(np.searchsorted(now.track, track))
        return SE3.from_xyz_yaw(self._on_ground(now.place[row : row + 1])[0], float(now.heading[row]))

    def _on_ground(self, place: Floats) -> Floats:
        """Return places (M, 3) on the ground of the scenario, whatever height the log has."""
        return np.column_stack([place[:, :2], self._layout.heights(place[:, :2])])
