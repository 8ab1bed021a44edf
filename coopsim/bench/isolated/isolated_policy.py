"""A policy whose agents each have a process of their own: what one knows of another has come over the channel."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import coopsim
from coopsim.bench.isolated.remote_guest import RemoteGuest, RemoteUplink
from coopsim.bench.store.fingerprint import named_files
from coopsim.catalog import PolicySpec
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.support.rng import derived_seed
from coopsim.types import AgentSpec, Observation, Tracks

if TYPE_CHECKING:
    from coopsim.agents.policy import Needs, Policy


class IsolatedPolicy(coopsim.Policy):
    """A policy with a process for each agent, which gets that agent's observations alone.

    A process gets the policy's spec, agents' specs, derived seeds, and observations; it answers tracks, maneuvers and
    messages, as data that name no code.

    Args:
        spec: the policy.
        limit_s: time limit of a frame.
        guest_seed: gives the seed that a process is told in place of another.
        needs: needs that the policy has stated before; None: it is asked.

    Raises:
        IsolatedPolicyError: the policy raised an error, took longer, answered nonsense, says that it needs something
            else than before, or a process died.
    """

    def __init__(
        self, spec: PolicySpec, limit_s: float, guest_seed: Callable[[int], int], needs: Needs | None = None
    ) -> None:
        self._spec, self._limit_s, self._guest_seed = spec, limit_s, guest_seed
        self._readable = [os.path.abspath(path) for path in (*_folder_of(spec), *named_files(dict(spec.parameters)))]
        self._guests: dict[str, RemoteGuest] = {}
        self._seed: int | None = None
        first = self._start(0)
        self._spare: RemoteGuest | None = first
        try:
            self.needs, self.method = _needs_of(first), str(first.made["method"])
            self._guarded, self.confinement = bool(first.made["guarded"]), first.confinement
            self._require_same(first, needs or self.needs)
            require_no_truth(spec, self)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the processes."""
        for guest in (*self._guests.values(), *([self._spare] if self._spare else [])):
            guest.process.end()

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        guest = self._guest(spec.name)
        made = guest.ask("make_uplink", spec, self._guest_seed(derived_seed(int(rng.integers(2**63)), "uplink")))
        try:
            return RemoteUplink(guest, made["content"], made["codec"], hears=made["hears"])
        except (TypeError, KeyError, CoopsimError) as error:
            raise guest.nonsense(f"no uplink ({error})") from error

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        self.require(agent_specs)
        self.specs, self._seed = dict(agent_specs), self._guest_seed(seed)
        for name in self._guests.keys() - agent_specs.keys():
            self._guests.pop(name).process.end()
        for guest in self._guests.values():
            guest.has_begun = False
            guest.give("reset", self.specs, self._seed)
        for guest in self._guests.values():
            guest.answer()

    def act(  # type: ignore[override]  # it gets no infos
        self, observations: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, dict[str, Any]]:
        guests = {name: self._guest(name) for name in observations}
        for name, guest in guests.items():
            guest.give("act", {name: observations[name]})
        actions = {}
        for name, guest in guests.items():
            answer = guest.answer()
            if not isinstance(answer, Mapping) or name not in answer:
                raise guest.nonsense(f"no action of {name}")
            actions[name], guest.has_begun = answer[name], True
        return actions

    def judgements(self, agents: Iterable[str]) -> dict[str, tuple[dict[str, float], int]]:
        return {agent: self._judgement(agent) for agent in agents} if self._guarded else {}

    @property
    def counts(self) -> Counter[str]:  # type: ignore[override]
        total = Counter[str]()
        for guest in self._guests.values():
            total.update(guest.ask("counts")["counts"])
        return total

    @property
    def rejected(self) -> Counter[tuple[str, str]]:  # type: ignore[override]
        """Number of messages that could not be read, all under one key: links are not told apart."""
        return Counter({("", ""): sum(int(guest.ask("counts")["rejected"]) for guest in self._guests.values())})

    def track(self, agent: str, observation: Observation) -> Tracks:
        raise InvalidValueError("a policy in a process of its own is asked for all agents together: call act")

    def _start(self, number: int) -> RemoteGuest:
        return RemoteGuest(self._spec, self._limit_s, self._readable, number)

    def _guest(self, agent: str) -> RemoteGuest:
        """Return an agent's process, which is started if need be."""
        if agent not in self._guests:
            guest, self._spare = self._spare or self._start(len(self._guests)), None
            self._guests[agent] = guest
            self._require_same(guest, self.needs)
            if self._seed is not None:
                guest.ask("reset", self.specs, self._seed)
        return self._guests[agent]

    def _require_same(self, guest: RemoteGuest, needs: Needs) -> None:
        if _needs_of(guest) != needs:
            raise guest.error(f"needs {_needs_of(guest)}, and said before that it needs {needs}")

    def _judgement(self, agent: str) -> tuple[dict[str, float], int]:
        guest = self._guest(agent)
        made = guest.ask("judgements", [agent])
        try:
            return _checked_trust(made[agent]["trust"]), int(made[agent]["passes"])
        except (TypeError, KeyError, ValueError, AttributeError) as error:
            raise guest.nonsense(f"no trust ({error})") from error


def require_no_truth(spec: PolicySpec, policy: Policy) -> None:
    """Refuse a policy that needs the truth, which its own process could not get."""
    if policy.needs.truth:
        raise InvalidValueError(
            f"policies must not need the truth to run in processes of their own, which get none; {spec.text!r} does"
        )


def _needs_of(guest: RemoteGuest) -> Needs:
    try:
        return coopsim.Needs(**guest.made["needs"])
    except (TypeError, KeyError) as error:
        raise guest.nonsense(f"no needs ({error})") from error


def _folder_of(spec: PolicySpec) -> list[str]:
    """Return the folder of the policy's file, beside which its data may be."""
    return [] if spec.source is None else [spec.place.rpartition("/")[0] or "."]


def _checked_trust(trust: Mapping[Any, Any]) -> dict[str, float]:
    """Return a process's answer if it is trust by sender. Raises `ValueError` for any other."""
    found = {str(sender): float(value) for sender, value in trust.items()}
    if not all(0 <= value <= 1 for value in found.values()):
        raise ValueError(f"trust must be in [0, 1], got {trust!r:.200}")
    return found
