"""The program of a process that runs one policy: it answers orders, which are all that it knows of the world."""

from __future__ import annotations

import os
import pickle
import threading
import time
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
from coopsim.support.threads import limit_threads
from coopsim.types import AgentSpec, Observation

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

_LONGEST_ERROR = 20_000


class Guest:
    """A policy and its uplinks, behind the orders of another process; each order's answer is plain data."""

    _policy: Policy

    def __init__(self) -> None:
        self._uplinks: dict[str, Uplink] = {}

    def make(self, spec: PolicySpec) -> dict[str, Any]:
        """Make the policy. Answer what an environment must know of it."""
        self._policy = spec.make()
        guarded = getattr(self._policy, "guard", None) is not None
        return {"needs": asdict(self._policy.needs), "method": str(self._policy.method), "guarded": guarded}

    def make_uplink(self, spec: AgentSpec, seed: int) -> dict[str, Any]:
        """Make what one agent broadcasts. Answer what it is, and the agent whose object it shares, or its own name."""
        if spec.name in self._uplinks:  # another episode begins
            self._uplinks = {}
        uplink = self._policy.make_uplink(spec, stream(seed, "uplink", spec.name))
        uplink.begin(spec, stream(seed, "uplink state", spec.name))
        self._uplinks[spec.name] = uplink
        return {
            "content": str(uplink.content),
            "codec": uplink.codec_name if isinstance(uplink, ContentUplink) else None,
            "hears": type(uplink).hear is not Uplink.hear,
            "object": next(name for name, each in self._uplinks.items() if each is uplink),
        }

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Any]:
        """Answer the messages, as bytes on the air, of agents that share an uplink."""
        uplink = self._uplinks[next(iter(observations))]
        return {name: encode_message(message) for name, message in uplink.messages(observations).items()}

    def hear(self, receiver: str, observation: Observation) -> None:
        """Let an agent's uplink hear the frame's inbox."""
        self._uplinks[receiver].hear(receiver, observation)

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


def serve() -> None:
    """Obey orders from the standard input until the process that gives them is gone."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    replies = os.dup(1)
    os.dup2(2, 1)  # what the policy prints must not get among the answers
    limit_threads(1)
    pipe, guest = Pipe(0, replies), Guest()
    while True:
        try:
            name, arguments = pickle.loads(pipe.receive())
        except EOFError:
            os._exit(0)
        pipe.send(_answer(getattr(guest, name), arguments))


def _answer(order: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    try:
        return pack_parcel({"answer": order(*arguments)})
    except CoopsimError as error:
        return pack_parcel({"error": f"{type(error).__name__}: {error}"})
    except BaseException as error:  # of a user's policy, SystemExit among them
        told = "".join(traceback.format_exception(error))
        return pack_parcel({"error": told[-_LONGEST_ERROR:]})


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)
