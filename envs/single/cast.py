"""The cast of a single-agent environment: the policies that act for all agents but the learner."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from coopsim.agents.policy import Policy
from coopsim.catalog import PolicySpec
from coopsim.errors import CoopsimError, InvalidValueError

PolicyLike = str | Policy | None
"""A policy's name or spec, the policy itself, or None: no policy."""

Others = PolicyLike | Mapping[str, PolicyLike]
"""One policy for all other agents, or one each, by agent."""

_ACCEPTED = 'a policy\'s name or spec, as "late_fusion(merge_iou=0.2)", a coopsim.Policy'


@dataclass(frozen=True, slots=True)
class Cast:
    """The policies by role.

    Attributes:
        tracker: reports the tracks of the ego; None: the learner does.
        others: of each agent that the user named; None for those that report nothing.
        everybody_else: of the agents that are not in `others`.
    """

    tracker: Policy | None = None
    others: Mapping[str, Policy | None] = field(default_factory=dict)
    everybody_else: Policy | None = None

    @classmethod
    def make(cls, tracker: object, others: object) -> Cast:
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
    def roles(self) -> dict[str, Policy]:
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
