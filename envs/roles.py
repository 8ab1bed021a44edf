"""Roles in a single-agent environment: policies of all agents but the learner, and what these policies need."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.agents.policy import Policy
from coopsim.catalog import PolicySpec
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.provided import agreed, provided_env
from coopsim.types import AgentSpec

PolicyLike = str | Policy | None
"""A policy's name or spec, the policy itself, or None: no policy."""

Others = PolicyLike | Mapping[str, PolicyLike]
"""One policy for all other agents, or one each, by agent."""

_ACCEPTED = 'a policy\'s name or spec, as "late_fusion(merge_iou=0.2)", a coopsim.Policy'


@dataclass(frozen=True, slots=True)
class Roles:
    """The policies by role.

    Attributes:
        tracker: reports the tracks of the ego; None: the learner does.
        others: policy of each agent that the user named; None for those that report nothing.
        everybody_else: policy of the agents that are not in `others`.
    """

    tracker: Policy | None = None
    others: Mapping[str, Policy | None] = field(default_factory=dict)
    everybody_else: Policy | None = None

    @classmethod
    def make(cls, tracker: object, others: object) -> Roles:
        """Make the policies that the user asked for.

        Equal specs give one policy, which serves several agents. Objects are copied, so that environments made with
        the same arguments, as those of a vector, share no state.

        Raises:
            CoopsimError: a name is unknown or a value is not accepted; the message says for which role.
        """
        maker = _PolicyMaker()
        made = maker.make("tracker", tracker)
        if not isinstance(others, Mapping):
            return cls(made, everybody_else=maker.make("others", others, ", a mapping of agents to these"))
        return cls(made, {agent: maker.make(f"others[{agent!r}]", each) for agent, each in others.items()})

    @property
    def by_name(self) -> dict[str, Policy]:
        """The policies by the role that messages call them by; others come first."""
        roles = {f"others[{agent!r}]": policy for agent, policy in self.others.items()}
        roles |= {"others": self.everybody_else, "tracker": self.tracker}
        return {role: policy for role, policy in roles.items() if policy is not None}

    def of(self, agent: str, *, ego: str) -> Policy | None:
        """Return the policy of an agent; of the ego it is the tracker."""
        return self.tracker if agent == ego else self.others.get(agent, self.everybody_else)


class _PolicyMaker:
    def __init__(self) -> None:
        self._by_spec: dict[str, Policy] = {}
        self._copied: dict[int, Any] = {}

    def make(self, role: str, given: object, also_accepted: str = "") -> Policy | None:
        if isinstance(given, type) and issubclass(given, Policy):
            raise InvalidValueError(
                f"{role} must be an object, got the class {given.__name__}: write {given.__name__}()"
            )
        if isinstance(given, str):
            return self._named(role, given)
        if isinstance(given, Policy):
            return self._copy(role, given)
        if given is not None:
            raise InvalidValueError(f"{role} must be {_ACCEPTED}{also_accepted}, or None; got {given!r}")
        return None

    def _named(self, role: str, text: str) -> Policy:
        try:
            spec = PolicySpec.parse(text)
            if spec.text not in self._by_spec:
                self._by_spec[spec.text] = spec.make()
        except CoopsimError as error:
            raise error.at(role) from error.__cause__
        return self._by_spec[spec.text]

    def _copy(self, role: str, policy: Policy) -> Policy:
        try:
            return copy.deepcopy(policy, self._copied)
        except Exception as error:  # a user's class may hold anything
            raise InvalidValueError(
                f"{role} must be a policy that can be copied, as environments share no state; {type(policy).__name__} "
                f"cannot ({type(error).__name__}: {error}): give its name or its place, as 'module:Class'"
            ) from error


_ROLES = ("ego", "others", "tracker")
"""Arguments that are no options of the environment of all agents, for the error that lists what is accepted."""


class Broadcasts:
    """An uplink option by which each agent broadcasts what its policy makes."""

    def __init__(self, default: Policy) -> None:
        self.by_agent: Mapping[str, Policy] = {}
        self._default = default

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        """Make what one agent broadcasts; see `Policy.make_uplink`."""
        return self.by_agent.get(spec.name, self._default).make_uplink(spec, rng)


def make_provided(
    environment: str | Path, roles: Mapping[str, Policy], options: Mapping[str, Any]
) -> tuple[CooperativeEnv, Broadcasts | None]:
    """Make an environment that provides what all policies need, wherever the options leave it open.

    Args:
        environment: name or scenario file, as in `parallel_env`.
        roles: the policies, by the role that messages call them by.
        options: options of the environment.

    Returns:
        The environment, and its uplink option; None where no policy decides it.

    Raises:
        PolicyMismatchError: two policies need different things, or the environment or the options exclude what one
            needs.
        CoopsimError: `parallel_env` refuses it.
    """
    broadcasts, given = None, dict(options)
    if "uplink" not in options and (content := agreed("uplink", _contents(roles))) is not None:
        given["uplink"] = broadcasts = Broadcasts(roles[content])
    try:
        return provided_env(environment, roles, given), broadcasts
    except UnknownNameError as error:
        if error.kind == "option":
            raise UnknownNameError("option", error.name, (*error.known, *_ROLES), error.where) from error.__cause__
        raise


def _contents(roles: Mapping[str, Policy]) -> dict[str, str]:
    return {role: policy.needs.uplink for role, policy in roles.items() if policy.needs.uplink != "none"}
