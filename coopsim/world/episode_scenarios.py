"""The scenario of each episode: always the same one, or another place for every seed."""

from __future__ import annotations

from abc import ABC, abstractmethod

from coopsim.world.scenario import Scenario


class EpisodeScenarios(ABC):
    """The scenarios of an environment's episodes, whose agents have the same names in all of them.

    Attributes:
        name: of the environment's scenario.
        most_actors: the largest number of actors in any of them; None: as many as are there at the start.
    """

    name: str
    most_actors: int | None = None

    @abstractmethod
    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""


class SameScenario(EpisodeScenarios):
    """The same scenario in all episodes.

    Args:
        scenario: the place and its population.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.name, self._scenario = scenario.name, scenario

    def of(self, seed: int) -> Scenario:
        """Return the scenario."""
        return self._scenario
