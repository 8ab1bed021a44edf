"""The environment that provides what several policies need: one uplink, LiDAR and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.agents.policy import Policy
from coopsim.catalog import parallel_env
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import PolicyMismatchError, UnknownNameError
from coopsim.types import AgentSpec

_ROLES = ("ego", "others", "tracker")
"""Arguments that are no options of the environment of all agents, for the error that lists what is accepted."""


class Broadcasts:
    """An uplink option by which each agent broadcasts what its policy makes.

    Attributes:
        by_agent: the policies that make their agents' uplinks, from the next episode on.

    Args:
        default: makes the uplinks of all other agents.
    """

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
        environment: as of `parallel_env`.
        roles: the policies, by the role that messages call them by.
        options: of the environment.

    Returns:
        The environment, and its uplink option; None where no policy decides it.

    Raises:
        PolicyMismatchError: two policies need different things, or the environment or the options exclude what one
            needs.
        CoopsimError: as `parallel_env` does.
    """
    needed: dict[str, Any] = {}
    broadcasts = None
    if "uplink" not in options and (content := _agreed("uplink", _contents(roles))) is not None:
        needed["uplink"] = broadcasts = Broadcasts(roles[content])
    if "cameras" not in options and (rig := _agreed("cameras", _rigs(roles))) is not None:
        needed["cameras"] = roles[rig].needs.cameras
    try:
        env = parallel_env(environment, **needed, **options)
    except UnknownNameError as error:
        if "cameras" in needed and error.name == "cameras":
            raise PolicyMismatchError(
                f"{_described(roles, rig)} needs cameras {needed['cameras']!r}, and {str(environment)!r} has none"
            ) from error
        if error.kind == "option":
            raise UnknownNameError("option", error.name, (*error.known, *_ROLES), error.where) from error.__cause__
        raise
    try:
        _require(env, roles, options)
    except PolicyMismatchError:
        env.close()
        raise
    return env, broadcasts


def _contents(roles: Mapping[str, Policy]) -> dict[str, str]:
    return {role: policy.needs.uplink for role, policy in roles.items() if policy.needs.uplink != "none"}


def _rigs(roles: Mapping[str, Policy]) -> dict[str, str]:
    rigs = {role: policy.needs.cameras for role, policy in roles.items()}
    return {role: "surround" if rig is True else rig for role, rig in rigs.items() if rig}


def _agreed(option: str, values: Mapping[str, str]) -> str | None:
    """Return the first role with a need for this option, None if there is none; refuse different needs."""
    if len(set(values.values())) > 1:
        needs = ", ".join(f"{role} {value!r}" for role, value in values.items())
        raise PolicyMismatchError(
            f"{option} is one for all agents, and the policies need different ones ({needs}): choose policies that "
            "need the same or none"
        )
    return next(iter(values), None)


def _require(env: CooperativeEnv, roles: Mapping[str, Policy], options: Mapping[str, Any]) -> None:
    for role, policy in roles.items():
        sent = next(iter(env.agent_specs.values())).uplink
        if policy.needs.uplink not in ("none", sent):
            raise PolicyMismatchError(
                f"{_described(roles, role)} needs uplink {policy.needs.uplink!r}, but the agents broadcast {sent!r}: "
                f"leave out uplink={options.get('uplink')!r}, and the policies decide it"
            )
        try:
            policy.require(env.agent_specs)
        except PolicyMismatchError as error:
            raise error.at(role) from error.__cause__


def _described(roles: Mapping[str, Policy], role: str | None) -> str:
    return f"{role} ({type(roles[role]).__name__})" if role is not None else "a policy"
