"""What a policy is: the part of coopsim that its users write.

A policy looks at one agent's observation and reports tracks. The smallest one has one method:

```python
class Copy(coopsim.Policy):
    uplink = "none"

    def track(self, agent, observation):
        found = observation.detections
        still = np.zeros((len(found), 2))
        return Tracks(np.arange(len(found)), found.boxes, still, found.score, found.label)
```
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np

from coopsim.errors import CodecError, EpisodeStateError, InvalidActionError, PolicyMismatchError
from coopsim.sensors.camera.rigs import rig
from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Message, Observation, Tracks
from coopsim.types.maneuvers import IDLE
from coopsim.wire.packing import pack_tracks, unpack_observation

T = TypeVar("T")


class Policy(ABC):
    """Tracks for any number of agents. One object serves all; state per agent is made in `begin`.

    Attributes:
        uplink: what the policy needs agents to broadcast; "none" if it reads no message.
        cameras: name of the rig whose cameras the policy needs on every agent (see `coopsim.sensors.camera.rigs`),
        True for
            "surround"; False if it looks at no picture, so that none is drawn for it.
        specs: the agents of the running episode, in the environment's order.
        rejected: how many messages of the episode could not be read, by receiver and sender; see `read`.
    """

    uplink: ClassVar[str] = "detections"
    cameras: ClassVar[bool | str] = False
    specs: Mapping[str, AgentSpec]
    rejected: Counter[tuple[str, str]]

    @abstractmethod
    def track(self, agent: str, observation: Observation) -> Tracks:
        """What `agent` reports for this observation, in its own base frame, now."""

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        """Called once per agent when an episode begins; make the agent's state here.

        Args:
            spec: the agent.
            rng: the agent's own random stream, for policies that draw.
        """

    def read(self, agent: str, inbox: Iterable[Message], decode: Callable[[Message], T]) -> list[tuple[Message, T]]:
        """The messages that can be read, each with what is in it. The others are left out and counted in `rejected`.

        Args:
            agent: who received them.
            inbox: as in the agent's observation.
            decode: of a message, as `coopsim.comms.envelope.decode_detections`; raises `CodecError` on what is none.
        """
        readable: list[tuple[Message, T]] = []
        for message in inbox:
            try:
                readable.append((message, decode(message)))
            except CodecError:
                self.rejected[agent, message.sender] += 1
        return readable

    def drive(self, agent: str, observation: Observation) -> int:
        """How `agent` drives, a number into `MANEUVERS`; asked only under `control="policy"`."""
        return IDLE

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        """Begin an episode with these agents, forgetting the last one.

        Raises:
            PolicyMismatchError: the environment's agents broadcast something else than the policy needs, or have not
                the cameras that it needs.
        """
        needed = {camera.name for camera in rig(self.cameras)}
        for spec in agent_specs.values():
            if self.uplink not in ("none", spec.uplink):
                raise PolicyMismatchError(
                    f"{type(self).__name__} needs uplink {self.uplink!r}, but {spec.name} broadcasts "
                    f"{spec.uplink!r}: make the environment with uplink={self.uplink!r}, or use "
                    "coopsim.evaluate, which does"
                )
            if not needed <= set(spec.cameras):
                raise PolicyMismatchError(
                    f"{type(self).__name__} needs cameras {sorted(needed)}, but {spec.name} has "
                    f"{sorted(spec.cameras)}: make the environment with cameras={self.cameras!r}, or use "
                    "coopsim.evaluate, which does"
                )
        self.specs, self.rejected = dict(agent_specs), Counter()
        for name, spec in self.specs.items():
            self.begin(spec, stream(seed, "policy", name))

    def act(self, observations: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        """Actions for all agents that observed something.

        Raises:
            EpisodeStateError: before `reset`.
            UnknownNameError: an agent is not among those that `reset` was given.
            InvalidActionError: `track` returned something else than tracks.
        """
        if not hasattr(self, "specs"):
            raise EpisodeStateError("act before reset: call policy.reset(env.agent_specs) first")
        for name in observations:
            require_choice("agent", name, self.specs)
        return {name: self._act_one(name, observation) for name, observation in observations.items()}

    def _act_one(self, agent: str, packed: Mapping[str, Any]) -> dict[str, Any]:
        observation = unpack_observation(packed, tuple(self.specs), self.specs[agent])
        tracks: object = self.track(agent, observation)
        if not isinstance(tracks, Tracks):
            got = type(tracks).__name__
            raise InvalidActionError(f"{type(self).__name__}.track must return Tracks, got {got} for {agent}")
        action: dict[str, Any] = {"tracks": pack_tracks(tracks)}
        if self.specs[agent].drives:
            action["maneuver"] = self.drive(agent, observation)
        return action
