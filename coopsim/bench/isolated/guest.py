"""The program of a process that runs one agent's policy: it answers orders, all that it knows of the world."""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from coopsim.bench.isolated.parcels import Pipe, pack_parcel
from coopsim.catalog import PolicySpec
from coopsim.comms.envelope import encode_message
from coopsim.comms.uplinks.uplink import ContentUplink, Uplink
from coopsim.errors import CoopsimError
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Observation

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

_LONGEST_ERROR = 20_000


class Guest:
    """A policy and its uplink, behind the orders of another process; each order's answer is plain data.

    Args:
        confinement: parts of this process's confinement, and whether they hold.
    """

    _policy: Policy
    _uplink: Uplink

    def __init__(self, confinement: Mapping[str, bool]) -> None:
        self._confinement = dict(confinement)

    def serve(self, pipe: Pipe) -> None:
        """Obey orders until the process that gives them is gone."""
        while True:
            try:
                name, arguments = pickle.loads(pipe.receive())
            except EOFError:
                os._exit(0)
            pipe.send(_answer(getattr(self, name), arguments))

    def confinement(self) -> dict[str, bool]:
        """Answer how this process is confined; asked before there is a policy."""
        return self._confinement

    def make(self, spec: PolicySpec) -> dict[str, Any]:
        """Make the policy. Answer what an environment must know of it."""
        self._policy = spec.make()
        guarded = getattr(self._policy, "guard", None) is not None
        return {"needs": asdict(self._policy.needs), "method": str(self._policy.method), "guarded": guarded}

    def make_uplink(self, spec: AgentSpec, seed: int) -> dict[str, Any]:
        """Make what the agent broadcasts. Answer what it is."""
        uplink = self._policy.make_uplink(spec, stream(seed, "uplink", spec.name))
        uplink.begin(spec, stream(seed, "uplink state", spec.name))
        self._uplink = uplink
        return {
            "content": str(uplink.content),
            "codec": uplink.codec_name if isinstance(uplink, ContentUplink) else None,
            "hears": type(uplink).hear is not Uplink.hear,
        }

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Any]:
        """Answer the agent's messages as bytes on the air."""
        return {name: encode_message(message) for name, message in self._uplink.messages(observations).items()}

    def hear(self, receiver: str, observation: Observation) -> None:
        """Let the agent's uplink hear the frame's inbox."""
        self._uplink.hear(receiver, observation)

    def reset(self, specs: Mapping[str, AgentSpec], seed: int) -> None:
        """Begin an episode."""
        self._policy.reset(specs, seed=seed)

    def act(self, observations: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Answer the actions for packed observations."""
        return self._policy.act(observations)

    def judgements(self, agents: Sequence[str]) -> dict[str, Any]:
        """Answer the trust and the passes of each agent's defence in the last frame."""
        found = self._policy.judgements(agents)
        return {agent: {"trust": trust, "passes": passes} for agent, (trust, passes) in found.items()}

    def counts(self) -> dict[str, Any]:
        """Answer what the policy counted, and the number of messages that it could not read."""
        rejected = getattr(self._policy, "rejected", {})
        return {"counts": dict(getattr(self._policy, "counts", {})), "rejected": sum(rejected.values())}


def _answer(order: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    try:
        return pack_parcel({"answer": order(*arguments)})
    except CoopsimError as error:
        return pack_parcel({"error": f"{type(error).__name__}: {error}"})
    except BaseException as error:  # of a user's policy, SystemExit among them
        told = "".join(traceback.format_exception(error))
        return pack_parcel({"error": told[-_LONGEST_ERROR:]})
