"""Views: ways to show an observation as arrays of fixed shapes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.parallel import CooperativeEnv
from coopsim.envs.wrappers.forms import AnySpace, ObservationForm, kind_of
from coopsim.envs.wrappers.received import Inbox, Received
from coopsim.errors import InvalidValueError
from coopsim.types import Observation
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import RoadMap

Arrays = dict[str, NDArray[Any]]


@dataclass(eq=False)
class Scene:
    """What one agent knows in one frame.

    Attributes:
        observation: the agent's own.
        inbox: reads its messages.
        agent: the agent's name.
    """

    observation: Observation
    inbox: Inbox
    agent: str

    @cached_property
    def received(self) -> Received:
        """Content of the messages that arrived, in the agent's base frame now."""
        return self.inbox.read(self.agent, self.observation)


class View(ABC):
    """A way to show a scene as named arrays, each of one shape for all agents and frames.

    Attributes:
        alone: name of the only array, which stands for itself where no other view is combined with this one; None if
            there may be several.
    """

    alone: ClassVar[str | None] = None

    @abstractmethod
    def spaces(self) -> dict[str, spaces.Box]:
        """Return new spaces of the arrays, by name: of each its shape, its dtype and the bounds of its numbers."""

    def begin(self, road_map: RoadMap) -> None:
        """Take over the map of an episode that begins."""

    @abstractmethod
    def show(self, scene: Scene) -> Arrays:
        """Return new arrays, by name: those of `spaces`, each in its space.

        All that has a place is in the agent's base frame now (m, rad), or in pixels of a picture around it.
        """


class Views(ObservationForm):
    """One or more views of the same observations.

    Args:
        views: the views; names of their arrays are distinct.

    Raises:
        InvalidValueError: two views have an array of the same name.
    """

    def __init__(self, views: Sequence[View]) -> None:
        names = [name for view in views for name in view.spaces()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InvalidValueError(f"env has such a wrapper already: {', '.join(twice)} would be there twice")
        self.views = tuple(views)
        self._alone = views[0].alone if len(views) == 1 else None

    def space(self, inner: AnySpace) -> AnySpace:
        if not (isinstance(inner, spaces.Dict) and "inbox_payload" in inner.spaces):
            raise InvalidValueError(
                f"env must have coopsim's own observations, which no wrapper changed, got {kind_of(inner)}"
            )
        parts: dict[str, AnySpace] = {name: space for view in self.views for name, space in view.spaces().items()}
        return spaces.Dict(parts) if self._alone is None else parts[self._alone]

    def begin(self, env: CooperativeEnv) -> None:
        specs = env.agent_specs
        self._format, self._inbox = ObservationFormat.to_unpack(specs), Inbox(specs)
        for view in self.views:
            view.begin(env.road_map)

    def observe(self, agent: str, observation: Mapping[str, Any]) -> Any:
        return self.observe_all({agent: observation})[agent]

    def observe_all(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        unpacked = self._format.unpack_all(observations)
        return {name: self._show(Scene(observation, self._inbox, name)) for name, observation in unpacked.items()}

    def _show(self, scene: Scene) -> Any:
        self._inbox.follow(scene.agent, scene.observation)
        shown = {name: array for view in self.views for name, array in view.show(scene).items()}
        return shown if self._alone is None else shown[self._alone]
