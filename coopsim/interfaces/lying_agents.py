"""The agents that lie: their attacks, applied to what leaves them in each frame, and the record of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.comms.uplinks.uplink import ContentUplink, Uplink
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.attack import (
    ATTACKS,
    KNOWLEDGE,
    Attack,
    AttackerView,
    OpenFacts,
    contents_of,
    hooks_of,
    make_attack,
)
from coopsim.interfaces.attack_option import AttacksOption, attacks_by_agent
from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Message, Observation, PoseEstimate
from coopsim.types.lies import Lie

_MOST_HEARD = 256
"""Senders of whom an attacker remembers messages: the latest."""


class LyingAgents:
    """The attacks of an episode, by agent. Without any it changes nothing.

    Args:
        option: the environment's option `attacks`.
        specs: specs of all agents.
        seed: the episode's seed.
        network: the policy whose weights attacks with the knowledge "weights" know; None: there is none.
        facts: facts that attackers can look up.

    Raises:
        UnknownNameError: there is no such agent.
    """

    def __init__(
        self,
        option: AttacksOption,
        specs: Mapping[str, AgentSpec],
        seed: int,
        network: object = None,
        facts: OpenFacts | None = None,
    ) -> None:
        self._agents: dict[str, _Liar] = {}
        kinds = {name: spec.kind for name, spec in specs.items()}
        for name, attacks in attacks_by_agent(option).items():
            require_choice("agent in attacks", name, specs)
            made = [make_attack(each) for each in attacks]
            self._agents[name] = _Liar(specs[name], made, seed, kinds, network, facts or OpenFacts())
        for name, liar in self._agents.items():
            for attack in liar.attacks:
                if attack.against is not None:
                    require_choice(f"against of {name}", attack.against, specs)

    def begin_frame(self, observations: Mapping[str, Observation]) -> None:
        """Begin the next frame, with all agents' own observations."""
        for name, liar in self._agents.items():
            liar.begin_frame(observations.get(name))

    def observed(self, name: str, observation: Observation, content: str) -> Observation:
        """Return the observation of an agent of which its message with this kind of content is made."""
        liar = self._agents.get(name)
        return observation if liar is None else liar.observed(observation, content)

    def uplink(self, uplink: Uplink, served: Sequence[str]) -> Uplink:
        """Return the uplink by which its agents lie; the same if all that it serves are honest.

        Raises:
            InvalidValueError: an attack cannot lie in this uplink's content.
        """
        lying = [name for name in served if name in self._agents]
        for name in lying:
            for attack in self._agents[name].attacks:
                _require_content(attack, uplink, name, self._agents[name].network)
        changes = any(_changes(attack, uplink.content) for name in lying for attack in self._agents[name].attacks)
        return LyingUplink(uplink, self._content) if changes and isinstance(uplink, ContentUplink) else uplink

    def send(self, name: str, message: Message | None) -> tuple[Message | None, Sequence[Message]]:
        """Return the message that an agent sends under its name, and those that it sends besides."""
        liar = self._agents.get(name)
        return (message, ()) if liar is None else liar.send(message)

    def hear(self, observations: Mapping[str, Observation]) -> None:
        """Let attackers hear the messages in their inboxes."""
        for name, liar in self._agents.items():
            if name in observations:
                liar.hear(observations[name].inbox)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the agents that may lie."""
        return tuple(self._agents)

    def lies(self, world_SE3_base: Mapping[str, SE3]) -> tuple[Lie, ...]:
        """Return the lies of the frame, given the agents' true places."""
        return tuple(
            lie
            for name, liar in self._agents.items()
            if name in world_SE3_base
            for lie in liar.lies(world_SE3_base[name])
        )

    def _content(self, name: str, content: Any, kind: str) -> Any:
        return content if name not in self._agents else self._agents[name].content(content, kind)


class LyingUplink(ContentUplink[Any]):
    """An uplink whose contents pass through attacks before they are encoded.

    Args:
        honest: the uplink.
        corrupt: function of an agent's name, its content and the kind of that, which returns the content to send.
    """

    def __init__(self, honest: ContentUplink[Any], corrupt: Callable[[str, Any, str], Any]) -> None:
        self.content = honest.content  # type: ignore[misc]  # of the class elsewhere
        self.codec, self.codec_name, self.beside = honest.codec, honest.codec_name, honest.beside
        self._honest, self._corrupt = honest, corrupt

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._honest.begin(spec, rng)

    def prepare_budget(self) -> None:
        self._honest.prepare_budget()
        self.codec, self.codec_name = self._honest.codec, self._honest.codec_name

    def content_of(self, sender: str, observation: Observation) -> Any:
        content = self._honest.content_of(sender, observation)
        return None if content is None else self._corrupt(sender, content, self.content)

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, Any]:
        return {
            sender: self._corrupt(sender, content, self.content)
            for sender, content in self._honest.contents(observations).items()
        }

    def encode_content(self, sender: str, content: Any) -> bytes:
        return self._honest.encode_content(sender, content)

    def message_with(self, sender: str, observation: Observation, payload: bytes) -> Message:
        return self._honest.message_with(sender, observation, payload)

    def hear(self, receiver: str, observation: Observation) -> None:
        self._honest.hear(receiver, observation)


class _Liar:
    """Attacks of an agent that lies."""

    def __init__(
        self,
        spec: AgentSpec,
        attacks: Sequence[Attack],
        seed: int,
        kinds: Mapping[str, str],
        network: object,
        facts: OpenFacts,
    ) -> None:
        self.attacks = attacks
        self._spec, self._kinds, self.network, self._facts = spec, kinds, network, facts
        self._rngs = [stream(seed, "attack", spec.name, str(number)) for number in range(len(attacks))]
        self._heard: dict[str, tuple[Message, ...]] = {}
        self._acting: list[tuple[Attack, AttackerView]] = []
        self._stated: PoseEstimate | None = None

    def begin_frame(self, observation: Observation | None) -> None:
        self._acting, self._stated = [], None
        if observation is None:
            return
        for attack, rng in zip(self.attacks, self._rngs, strict=True):
            known = self._known(attack)
            view = AttackerView(self._spec, observation, rng, known, self._kinds, facts=self._facts)
            if attack.knowledge == KNOWLEDGE[-1]:
                view.network = self.network
            if attack.active(view.time_s):
                self._acting.append((attack, view))

    def observed(self, observation: Observation, content: str) -> Observation:
        for attack, view in self._acting:
            hooks = hooks_of(type(attack))
            if content == "detections" and "detect" in hooks:
                observation = replace(observation, detections=attack.detect(view, observation.detections))
            elif content in ("points", "features", "queries") and "sense" in hooks:
                observation = replace(observation, sweeps=attack.sense(view, observation.sweeps))
        return observation

    def content(self, content: Any, kind: str) -> Any:
        for attack, view in self._acting:
            if kind == "tracks":
                content = attack.track(view, content)
            elif kind in ("features", "queries"):
                content = attack.encode(view, content)
        return content

    def send(self, message: Message | None) -> tuple[Message | None, Sequence[Message]]:
        further: list[Message] = []
        for attack, view in self._acting:
            if message is not None:
                before = message.identity
                message = attack.send(view, message)
                if message is None or message.identity != before:
                    view.lie()
            for each in attack.further(view, message):
                view.lie(each.sender)
                further.append(each)
        self._stated = None if message is None else message.pose
        return message, further

    def hear(self, inbox: Sequence[Message]) -> None:
        for message in inbox:
            before = self._heard.pop(message.sender, ())  # to the end: the latest are kept
            self._heard[message.sender] = (*before, message)[-2:]
        for name in list(self._heard)[:-_MOST_HEARD]:
            del self._heard[name]

    def lies(self, true_SE3_base: SE3) -> list[Lie]:
        """Return the lies of the frame."""
        found = []
        for attack, view in self._acting:
            if not view.senders:
                continue
            stated = view.observation.pose if self._stated is None else self._stated
            ids = [ids for ids, _ in view.claims]
            found.append(
                Lie(
                    view.observation.time_ns,
                    self._spec.name,
                    _name_of(attack),
                    tuple(sorted(view.senders)),
                    np.concatenate(ids) if ids else np.zeros(0, np.int64),
                    Boxes3D.concatenate(boxes for _, boxes in view.claims).transform(stated.world_SE3_base),
                    Boxes3D.concatenate(view.denials).transform(true_SE3_base),
                    view.against,
                    (float(stated.xyz_yaw[0]), float(stated.xyz_yaw[1])),
                )
            )
        return found

    def _known(self, attack: Attack) -> Mapping[str, Sequence[Message]]:
        level = KNOWLEDGE.index(attack.knowledge)
        if level == 0:
            return {}
        if level == 1:
            return {name: [replace(each, payload=b"") for each in heard] for name, heard in self._heard.items()}
        return dict(self._heard)


def _name_of(attack: Attack) -> str:
    try:
        return ATTACKS.name_of(type(attack))
    except UnknownNameError:  # of a user's file
        return type(attack).__name__


def _require_content(attack: Attack, uplink: Uplink, agent: str, network: object) -> None:
    accepted, hooks = attack.accepted(), hooks_of(type(attack))
    if not hooks:
        raise InvalidValueError(f"attack {_name_of(attack)!r} overrides no hook, so it has no effect")
    if uplink.content == "none":  # an agent that says nothing cannot lie: the line of one's own view alone
        return
    if attack.knowledge == KNOWLEDGE[-1] and not (hasattr(network, "heat") or hasattr(network, "shown")):
        raise InvalidValueError(
            f"attack {_name_of(attack)!r} needs the weights of a policy on maps of features or on queries, such as "
            f"attfuse or cooptrack, as the option uplink: got {network!r}"
        )
    if accepted and uplink.content not in accepted:
        which = "" if accepted == contents_of(type(attack)) else " with these parameters"
        raise InvalidValueError(
            f"attack {_name_of(attack)!r} lies{which} in {' or '.join(accepted)}, and {agent} broadcasts "
            f"{uplink.content!r}: choose another attack, or a policy with another uplink"
        )
    if _changes(attack, uplink.content) and not (isinstance(uplink, ContentUplink) and uplink.shows_content):
        raise InvalidValueError(
            f"attack {_name_of(attack)!r} lies in {uplink.content} before the codec, which needs a ContentUplink in "
            f"this process, got {type(uplink).__name__}"
        )


def _changes(attack: Attack, content: str) -> bool:
    """Return whether an attack changes content that an uplink has made, before its codec."""
    hook = {"tracks": "track", "features": "encode", "queries": "encode"}.get(content)
    return hook in hooks_of(type(attack))
