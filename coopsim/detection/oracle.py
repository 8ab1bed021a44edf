"""Simulated detectors: boxes made from the truth, as far as the LiDAR's returns support it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from coopsim.detection.detector import DetectorBase
from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.support.methods import is_newer
from coopsim.types import Detections, Ints, SensorView
from coopsim.world.snapshot import Actors


@dataclass(frozen=True, slots=True, eq=False)
class Oracle:
    """Truth around one agent in one frame. Only `OracleDetector`s are given it.

    Attributes:
        actors: all N actors but the agent itself, in its base frame.
        returns: (N,) number of LiDAR returns from each; where no rays are cast, the number to expect.
        world_SE3_base: the agent's true pose.
    """

    actors: Actors
    returns: Ints
    world_SE3_base: SE3


@dataclass(frozen=True, slots=True, eq=False)
class Oracles(Mapping[str, Oracle]):
    """Truth around each of A agents in one frame: a mapping, stored as rows, one agent's after another's.

    Attributes:
        agents: A names.
        start: (A + 1,) first row of each agent; the last is K.
        actors: K rows, each in the base frame of its agent; an actor has a row for each agent but itself.
        returns: (K,) number of LiDAR returns that the row's agent has from the actor.
        world_SE3_base: the agents' true poses.
        base_SE3_world: their inverses.
    """

    agents: tuple[str, ...]
    start: Ints
    actors: Actors
    returns: Ints
    world_SE3_base: tuple[SE3, ...]
    base_SE3_world: SE3Batch

    @classmethod
    def of(cls, oracles: Mapping[str, Oracle], agents: Iterable[str] | None = None) -> Self:
        """Return the same truth as rows, of these agents, at least one; None: of all."""
        names = tuple(oracles if agents is None else agents)
        if isinstance(oracles, cls) and names == oracles.agents:
            return oracles
        each = [oracles[name] for name in names]
        poses = tuple(oracle.world_SE3_base for oracle in each)
        return cls(
            names,
            np.cumsum([0, *(len(oracle.actors) for oracle in each)]),
            Actors.concatenate([oracle.actors for oracle in each]),
            np.concatenate([np.zeros(0, np.int64), *(oracle.returns for oracle in each)]),
            poses,
            SE3Batch.of([pose.inverse() for pose in poses]),
        )

    def __getitem__(self, agent: str) -> Oracle:
        if agent not in self.agents:
            raise KeyError(agent)
        k = self.agents.index(agent)
        rows = slice(*self.start[k : k + 2])
        return Oracle(self.actors[rows], self.returns[rows], self.world_SE3_base[k])

    def __iter__(self) -> Iterator[str]:
        return iter(self.agents)

    def __len__(self) -> int:
        return len(self.agents)


class OracleDetector(DetectorBase, ABC):
    """A detector that is simulated: it thins and disturbs the truth. It needs no sensors of its own.

    A subclass that overrides `detect` alone is asked agent by agent, whatever its base class does for all at once.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if is_newer(cls, "detect", "detect_all"):
            cls.detect_all = OracleDetector.detect_all  # type: ignore[method-assign]

    @abstractmethod
    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame.

        Args:
            view: the agent's sensor data, in its base frame.
            oracle: the truth around the agent.
            rng: the agent's random stream for this purpose.

        Returns:
            The reported objects, in the agent's base frame.
        """

    def detect_all(
        self, views: Mapping[str, SensorView], oracles: Mapping[str, Oracle], rngs: Mapping[str, np.random.Generator]
    ) -> dict[str, Detections]:
        """Report the objects of one frame for all agents; all arguments and the result are by agent."""
        return {agent: self.detect(view, oracles[agent], rngs[agent]) for agent, view in views.items()}


def split_by_agent(detections: Detections, agents: Sequence[str], owner: Ints) -> dict[str, Detections]:
    """Split N detections of all agents, whose numbers are `owner` (N,), by agent; each agent's keep their order."""
    if len(agents) == 1:
        return {agents[0]: detections}
    ordered = detections[np.argsort(owner, kind="stable")]
    end = np.cumsum(np.bincount(owner, minlength=len(agents))).tolist()
    return {agent: ordered[begin:stop] for agent, begin, stop in zip(agents, [0, *end], end, strict=False)}
