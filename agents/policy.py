"""The policy interface: the part of coopsim that its users write.

A policy looks at one agent's observation and reports tracks. The smallest one has one method:

```python
class Copy(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")

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
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.uplink import Uplink, named_uplink
from coopsim.errors import CodecError, EpisodeStateError, InvalidActionError, InvalidValueError, PolicyMismatchError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.camera.camera import rig_camera_names
from coopsim.support.checks import require_choice, require_flag
from coopsim.support.methods import is_newer
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, GroundTruth, Message, Observation, Tracks
from coopsim.types.driving import Command
from coopsim.wire.actions import MESSAGE, idle, pack_tracks
from coopsim.wire.message_parts import everything
from coopsim.wire.observation_format import ObservationFormat

if TYPE_CHECKING:
    from coopsim.interfaces.defense import DefenseOption
    from coopsim.interfaces.guard import Guard

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Needs:
    """Requirements of a policy on its environment.

    Attributes:
        uplink: the content that agents must broadcast: "detections", "tracks", "points", ...; "none" for a policy that
            reads no message.
        lidar: the policy reads LiDAR sweeps.
        cameras: name of the rig whose cameras every agent must have (see `coopsim.sensors.camera.camera`), True for
            "surround"; False: the policy reads no image, and none is rendered for it.
        any_rig: other cameras than those of `cameras` serve as well, if every agent has one.
        all_agents: every agent must have these sensors; without, those that have them are enough.
        truth: the policy is told the true objects, in `Observation.truth`. So it is an upper bound, and no competitor:
            tables mark it, and leaderboards refuse it.

    Raises:
        InvalidValueError: a value has the wrong type.
        UnknownNameError: no rig has that name.
    """

    uplink: str = "detections"
    lidar: bool = False
    cameras: bool | str = False
    any_rig: bool = False
    all_agents: bool = True
    truth: bool = False

    def __post_init__(self) -> None:
        if not (isinstance(self.uplink, str) and self.uplink):
            raise InvalidValueError(f"uplink must be the name of a content, got {self.uplink!r}")
        require_flag(lidar=self.lidar, any_rig=self.any_rig, all_agents=self.all_agents, truth=self.truth)
        rig_camera_names(self.cameras)


class Policy(ABC):
    """Tracks for any number of agents. One object serves all; make the state of an agent in `begin`.

    Attributes:
        needs: requirements on the environment; of the class, or set on the object.
        method: the paper's method that the policy is, or part of it, in a phrase; leaderboards show it.
        specs: the agents of the running episode, in the environment's order.
        rejected: number of messages of the episode that could not be read, by receiver and sender; see `read`.
        counts: counters of the episode for reports, by name in plain words, e.g. how often a fallback was used.
        guard: the defences of the receivers, see `defend`; None: every sender is believed.
    """

    needs: Needs = Needs()
    method: str = ""
    specs: Mapping[str, AgentSpec]
    rejected: Counter[tuple[str, str]]
    counts: Counter[str]
    guard: Guard | None = None
    _reads_points = ""  # who needs a LiDAR in place of the policy itself

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if is_newer(cls, "track", "track_all") and cls.track_all is not Policy.track_all:
            raise TypeError(
                f"{cls.__name__} overrides track and inherits a track_all that may not ask it: override track_all, "
                "too; track_all = coopsim.Policy.track_all asks track for each agent"
            )

    @abstractmethod
    def track(self, agent: str, observation: Observation) -> Tracks:
        """Return the tracks that `agent` reports for this observation, in its base frame at the observation's time."""

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        """Return the tracks that each agent reports for its observation of one frame, by agent.

        By default `track` is asked for each agent, in order. Override it to compute all agents in one batch, as by one
        forward pass of a network; a subclass of such a policy that overrides `track` must override this, too.

        Args:
            observations: observations by agent. Receivers of one broadcast have the same `Message` object in their
                inboxes.
        """
        return {agent: self.track(agent, observation) for agent, observation in observations.items()}

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        """Make the state of one agent; called once per agent when an episode begins.

        Args:
            spec: the agent.
            rng: the agent's own random stream, for policies that draw random numbers.
        """

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        """Make what one agent broadcasts; the environment asks when an episode begins, before `reset` is called.

        By default it is the uplink called `needs.uplink`. Override it to broadcast what the policy computes: see
        `coopsim.comms.uplinks.once_per_frame` for sharing the computation with `track`. Several agents may share an
        object.

        Args:
            spec: the agent, with the codec that was asked for.
            rng: the agent's own random stream, for uplinks that draw random numbers.
        """
        return named_uplink(self.needs.uplink, spec.codec)

    def read(self, agent: str, inbox: Iterable[Message], decode: Callable[[Message], T]) -> list[tuple[Message, T]]:
        """Decode messages. Those that cannot be read are left out, and counted in `rejected`.

        Args:
            agent: the receiver.
            inbox: messages, as in the agent's observation.
            decode: the content of a message, a pure function as `coopsim.comms.envelope.decode_detections`; raises
                `CodecError` for a message without that content. A broadcast is decoded once for all receivers.

        Returns:
            The readable messages, each with its content, which is read-only: other receivers get the same object.
        """
        readable: list[tuple[Message, T]] = []
        for message in inbox:
            try:
                readable.append((message, self._decoded(message, decode)))
            except CodecError:
                self.rejected[agent, message.sender] += 1
        return readable

    def drive(self, agent: str, observation: Observation) -> Command:
        """Choose how `agent` drives: an index into `MANEUVERS`, or an acceleration in m/s², see `AgentSpec.command`.

        Called only under `control="policy"` and "acceleration", for each agent that drives, after the tracks of all
        agents. By default the car keeps its lane and speed.
        """
        return idle(self.specs[agent].command)

    def speak(self, agent: str, observation: Observation) -> Mapping[str, Any] | None:
        """Choose what `agent` sends of this observation: the part `message` of its action; None: nothing.

        Called only with `uplink="action"`, after the tracks of all agents. By default all detections go to all agents,
        the surest first; where messages are payloads, nothing is sent.
        """
        part = self.specs[agent].message
        return None if part is None else everything(part, observation.detections)

    def defend(self, defense: DefenseOption) -> None:
        """Set the defence of the receivers, and add to `needs` what it reads; None: every sender is believed.

        Policies with a parameter `defense` call it when they are made.

        Raises:
            CoopsimError: there is no such defence, or a parameter is not accepted.
            InvalidValueError: the policy reads no message.
        """
        if defense is None:
            return
        from coopsim.interfaces.guard import Guard

        if self.needs.uplink == "none":
            raise InvalidValueError(f"defense must be None for a policy that reads no message, got {defense!r}")
        self.guard = Guard(defense)
        if self.guard.needs_lidar and not self.needs.lidar:
            self._reads_points = f"the defense {defense!r} of {type(self).__name__}"
        lidar, truth = self.needs.lidar or self.guard.needs_lidar, self.needs.truth or self.guard.needs_truth
        self.needs = replace(self.needs, lidar=lidar, truth=truth)

    def trust(self, agent: str) -> dict[str, float]:
        """Return how far `agent` trusts each sender that it has heard, in [0, 1], as of its last frame.

        Without a defence nothing is known, and the mapping is empty.
        """
        return {} if self.guard is None else self.guard.trust(agent)

    def judgements(self, agents: Iterable[str]) -> dict[str, tuple[dict[str, float], int]]:
        """Return the trust of each agent as of its last frame, and the passes of the policy that its defence asked for.

        Without a defence there are none, and the mapping is empty; so it is before `reset`.
        """
        if self.guard is None:
            return {}
        passes = self.guard.passes()
        return {agent: (self.trust(agent), passes[agent]) for agent in agents if agent in passes}

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        """Begin an episode with these agents, and forget the last one.

        Raises:
            PolicyMismatchError: the environment lacks what the policy needs, see `require`.
        """
        self.require(agent_specs)
        self.specs, self.rejected, self._decoded = dict(agent_specs), Counter(), DecodeOnce()
        self.counts = Counter()
        if self.guard is not None:
            self.guard.reset(seed, self.counts)
        self._format = ObservationFormat.to_unpack(self.specs)
        for name, spec in self.specs.items():
            self.begin(spec, stream(seed, "policy", name))
            if self.guard is not None:
                self.guard.begin(spec)

    def require(self, agent_specs: Mapping[str, AgentSpec]) -> None:
        """Refuse an environment that lacks what the policy `needs`.

        Raises:
            PolicyMismatchError: agents broadcast other content than the policy needs, or lack its LiDAR or cameras.
        """
        me, needs, hint = type(self).__name__, self.needs, "or use coopsim.evaluate, which does"
        needed = rig_camera_names(needs.cameras)
        for spec in agent_specs.values():
            if needs.uplink not in ("none", spec.uplink):
                raise PolicyMismatchError(
                    f"{me} needs uplink {needs.uplink!r}, but {spec.name} broadcasts {spec.uplink!r}: make the "
                    f"environment with uplink=policy, {hint}"
                )
            if not needs.all_agents:
                continue
            if needs.lidar and not spec.lidars:
                raise PolicyMismatchError(
                    f"{self._reads_points or me} needs a LiDAR, but {spec.name} has none: make the environment with "
                    'one, as lidar="HDL-32E", for all agents, with lidar_agents=None; with lidar=None, or in a replay, '
                    "there are no sweeps"
                )
            if needed and needs.any_rig and spec.cameras:
                continue
            if not needed <= set(spec.cameras):
                raise PolicyMismatchError(
                    f"{me} needs cameras {sorted(needed)}, but {spec.name} has {sorted(spec.cameras)}: make the "
                    f"environment with cameras={needs.cameras!r}, {hint}"
                )

    def act(
        self, observations: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Mapping[str, Any]] | None = None
    ) -> dict[str, dict[str, Any]]:
        """Return the actions of all agents that have an observation.

        Args:
            observations: observations by agent.
            infos: infos of the same frame; read by no policy but one that `needs` the truth.

        Raises:
            EpisodeStateError: before `reset`.
            PolicyMismatchError: the policy needs the truth, and the infos lack it.
            UnknownNameError: an agent is not among those given to `reset`.
            InvalidActionError: `track` returned something other than `Tracks`, or `track_all` returned them
                for other agents than it was given.
        """
        if not hasattr(self, "specs"):
            raise EpisodeStateError("act before reset: call policy.reset(env.agent_specs) first")
        for name in observations:
            require_choice("agent", name, self.specs)
        seen = self._format.unpack_all(observations)
        if self.needs.truth:
            seen = {name: _told(each, (infos or {}).get(name, {})) for name, each in seen.items()}
        reported: Mapping[str, object] = self.track_all(seen)  # custom policies may ignore the annotation
        if not (isinstance(reported, Mapping) and set(reported) == set(seen)):
            got = sorted(map(str, reported)) if isinstance(reported, Mapping) else type(reported).__name__
            raise InvalidActionError(
                f"{type(self).__name__}.track_all must return Tracks by agent for {list(seen)}, got {got}"
            )
        return {name: self._action(name, observation, reported[name]) for name, observation in seen.items()}

    def _action(self, agent: str, observation: Observation, tracks: object) -> dict[str, Any]:
        if not isinstance(tracks, Tracks):
            got = type(tracks).__name__
            raise InvalidActionError(f"{type(self).__name__}.track must return Tracks, got {got} for {agent}")
        action: dict[str, Any] = {"tracks": pack_tracks(tracks)}
        command = self.specs[agent].command
        if command is not None:
            action[command] = self.drive(agent, observation)
        if self.specs[agent].message is not None:
            action[MESSAGE] = self.speak(agent, observation)
        return action


def _told(observation: Observation, info: Mapping[str, Any]) -> Observation:
    """Return an observation with the truth in the agent's info."""
    return replace(observation, truth=_truth_in(info), attackers=frozenset(info.get("attackers", ())))


def _truth_in(info: Mapping[str, Any]) -> GroundTruth:
    """Read the truth in an agent's info."""
    if "ground_truth" not in info:
        raise PolicyMismatchError(
            "a policy that needs the truth reads it in the infos: make the environment with expose_ground_truth=True, "
            "and call policy.act(observations, infos), or use coopsim.evaluate, which does"
        )
    columns = info["ground_truth"]
    known = {name: columns.get(name) for name in ("visible_to", "velocity", "returns", "in_region", "counts")}
    return GroundTruth(columns["id"], Boxes3D.from_array(columns["box"]), columns["label"], **known)
