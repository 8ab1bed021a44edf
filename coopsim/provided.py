"""Environments that provide what policies need: cameras and the truth, wherever the options leave them open."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.catalog import parallel_env
from coopsim.errors import InvalidValueError, PolicyMismatchError, UnknownNameError

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv


def listening_env(environment: str, policy: Policy, options: Mapping[str, Any]) -> CooperativeEnv:
    """Make the environment that provides what one policy of all agents needs: its uplink, LiDAR, cameras, or the truth.

    Raises:
        CoopsimError: an uplink is among the options, or the environment cannot provide what the policy needs.
    """
    needs = policy.needs
    if "uplink" in options:
        raise InvalidValueError(
            f"uplink is not an option here: {type(policy).__name__} decides it, and says {needs.uplink!r}"
        )
    if needs.uplink == "none":  # the codec is for the content of other policies in the same comparison
        options = {name: value for name, value in options.items() if name != "codec"}
    return provided_env(environment, {"": policy}, {"uplink": policy, **options})


def provided_env(environment: str | Path, roles: Mapping[str, Policy], options: Mapping[str, Any]) -> CooperativeEnv:
    """Make an environment with the cameras and the truth that policies need, whose uplink the options name.

    Args:
        environment: name or scenario file, as in `parallel_env`.
        roles: the policies, by the role that messages call them by; empty for the only one.
        options: options of the environment.

    Raises:
        PolicyMismatchError: two policies need different things, or the environment or the options exclude what one
            needs.
        CoopsimError: `parallel_env` refuses it.
    """
    rig = None if "cameras" in options else agreed("cameras", _rigs(roles))
    given = dict(options) if rig is None else {**options, "cameras": roles[rig].needs.cameras}
    if told := [role for role, policy in roles.items() if policy.needs.truth]:
        if not options.get("expose_ground_truth", True):
            raise PolicyMismatchError(f"{described(roles, told[0])} needs the truth: leave out expose_ground_truth")
        given["expose_ground_truth"] = True
    try:
        env = parallel_env(environment, **given)
    except UnknownNameError as error:
        if rig is not None and error.name == "cameras":
            raise PolicyMismatchError(
                f"{described(roles, rig)} needs cameras {given['cameras']!r}, and {str(environment)!r} has none"
            ) from error
        raise
    try:
        for role, policy in roles.items():
            _require(env, role, policy, options)
    except PolicyMismatchError:
        env.close()
        raise
    return env


def agreed(option: str, values: Mapping[str, str]) -> str | None:
    """Return the first role with a need for this option, None if there is none; refuse different needs."""
    if len(set(values.values())) > 1:
        needs = ", ".join(f"{role} {value!r}" for role, value in values.items())
        raise PolicyMismatchError(
            f"{option} is one for all agents, and the policies need different ones ({needs}): choose policies that "
            "need the same or none"
        )
    return next(iter(values), None)


def described(roles: Mapping[str, Policy], role: str) -> str:
    """Return a role with the class of its policy, for messages."""
    kind = type(roles[role]).__name__
    return f"{role} ({kind})" if role else kind


def _rigs(roles: Mapping[str, Policy]) -> dict[str, str]:
    rigs = {role: policy.needs.cameras for role, policy in roles.items()}
    return {role: "surround" if rig is True else rig for role, rig in rigs.items() if rig}


def _require(env: CooperativeEnv, role: str, policy: Policy, options: Mapping[str, Any]) -> None:
    sent = next(iter(env.agent_specs.values())).uplink
    if policy.needs.uplink not in ("none", sent):
        raise PolicyMismatchError(
            f"{described({role: policy}, role)} needs uplink {policy.needs.uplink!r}, but the agents broadcast "
            f"{sent!r}: leave out uplink={options.get('uplink')!r}, and the policies decide it"
        )
    try:
        policy.require(env.agent_specs)
    except PolicyMismatchError as error:
        raise error.at(role or None) from error.__cause__
