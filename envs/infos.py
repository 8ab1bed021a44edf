"""Infos of agents: what a learner logs of its own car, step by step, how its episode ended, and the truth if asked for.

| key | in | meaning |
|---|---|---|
| `speed_m_s` | all infos | the car's speed along its heading |
| `progress` | all infos | distance driven so far, per cent of that at the legal speed: the metric `progress` |
| `crashed` | all infos | the car has touched another body |
| `hit_by_log` | all infos | what it touched first follows a log, which cannot see the car, and drove into it |
| `red_lights` | all infos | number of red lights that the car has run so far: its front crossed the line |
| `route_completion` | all infos of steered cars | share of the way to the goal that is behind the car, in [0, 1] |
| `arrive_dest` | all infos of steered cars | the car has reached its goal |
| `out_of_route` | all infos of steered cars | its route is more than 30 m away |
| `wrong_way` | all infos of steered cars | it is on lanes that all lead the other way |
| `counts` | infos of steps | of the frame's tracks, of all agents |
| `reward_parts` | infos of steps | the parts of the reward by name; their sum is the reward |
| `is_success` | the last, in situations | the car has not crashed |
| `end` | the last, of all agents | why the episode is over: see `coopsim.envs.frames.Frame` |
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coopsim.envs.frames import AgentFrame, Frame, truth_infos, with_lies
from coopsim.envs.options import CommonOptions
from coopsim.metrics.evaluator import FrameCounts
from coopsim.types import NS_PER_S
from coopsim.types.lies import Lie


@dataclass(slots=True)
class _Way:
    """Way of a car up to its crash: metres driven, those at the legal speed in the same time, whether it arrived."""

    driven_m: float = 0.0
    legal_m: float = 0.0
    arrived: bool = False

    def add(self, before: AgentFrame, after: AgentFrame, between_s: float) -> None:
        """Add the step between two frames."""
        assert before.car is not None
        if not before.car.crashed:
            (x, y, _), (from_x, from_y, _) = (each.body.world_SE3_base.translation.tolist() for each in (after, before))
            self.driven_m += math.hypot(x - from_x, y - from_y)
            self.legal_m += float(before.car.route.speed_limit_m_s[0]) * between_s

    @property
    def progress(self) -> float:
        """Metres driven, per cent of those at the legal speed; 0 while there are none of either."""
        return 100 * self.driven_m / self.legal_m if self.legal_m > 0 else 0.0


Infos = dict[str, dict[str, Any]]
"""Infos by agent."""


class EpisodeInfos:
    """Infos of one episode, by agent. Unless the truth is exposed, an agent is told of its own car alone.

    Args:
        frame: first frame of the episode.
        options: the environment's options, which may expose the truth.
        staged: the episode is a situation, which a car can survive.
    """

    def __init__(self, frame: Frame, options: CommonOptions, *, staged: bool) -> None:
        self._ways = {name: _Way() for name, agent in frame.agents.items() if agent.car is not None}
        self._options, self._staged = options, staged

    def of_reset(self, frame: Frame, told: Mapping[str, Any], lies: Sequence[Lie]) -> Infos:
        """Return the infos of the first frame, each with what all are `told`."""
        own, truth = self._of_cars(frame), self._truths(frame, lies)
        return {name: {**told, **own[name], **truth.get(name, {})} for name in frame.agents}

    def of_step(
        self,
        before: Frame,
        after: Frame,
        counts: Mapping[str, FrameCounts],
        parts: Mapping[str, Mapping[str, float]],
        lies: Sequence[Lie],
    ) -> Infos:
        """Return the infos after the step between two frames, of the agents with counts; `parts` are of rewards."""
        between_s = (after.time_ns - before.time_ns) / NS_PER_S
        for name, way in self._ways.items():
            way.add(before.agents[name], after.agents[name], between_s)
        own, truth = self._of_cars(after), self._truths(after, lies)
        for name in self._ways:
            own[name]["reward_parts"] = dict(parts[name])
        return {
            name: {"counts": each.as_dict(), **own.get(name, {}), **truth.get(name, {})}
            for name, each in counts.items()
        }

    def _truths(self, frame: Frame, lies: Sequence[Lie]) -> Infos:
        """Return the truth around each agent, where the environment was made to expose it."""
        if not self._options.expose_ground_truth:
            return {}
        return with_lies(truth_infos(frame, visibility=self._options.expose_visibility), lies)

    def _of_cars(self, frame: Frame) -> Infos:
        """Return the state of each driven car, and at the end what became of it."""
        infos: Infos = {name: {"end": frame.end} if frame.last else {} for name in frame.agents}
        for name, way in self._ways.items():
            car = frame.agents[name].car
            assert car is not None
            infos[name] |= {"speed_m_s": car.speed_m_s, "progress": way.progress}
            infos[name] |= {"crashed": car.crashed, "hit_by_log": car.hit_by_log, "red_lights": car.red_lights}
            if math.isfinite(car.route.length_m):
                way.arrived |= car.route.arrived and not car.crashed
                completion = 1.0 if way.arrived else car.route.completion
                infos[name] |= {"route_completion": completion, "arrive_dest": way.arrived}
                infos[name] |= {"out_of_route": car.route.strayed, "wrong_way": car.wrong_way}
            if frame.last and self._staged:
                infos[name]["is_success"] = not car.crashed
        return infos
