"""Policies and environments by name. Both live outside the library, which finds them when first asked."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from coopsim.errors import UnknownNameError
from coopsim.registry import Registry

if TYPE_CHECKING:
    from coopsim.agents.base import Policy
    from coopsim.envs.parallel import CooperativeEnv

NAMESPACE = "coopsim"

POLICIES: Registry[type[Policy]] = Registry("policy", home="coopsim.agents", group="coopsim.policies")
"""Policy classes; an installed package adds its own through the entry-point group `coopsim.policies`."""

ENVIRONMENTS: Registry[Callable[..., CooperativeEnv]] = Registry("environment", home="coopsim.envs")
"""Functions that make an environment, by versioned name (`crossing-v0`)."""


def make_policy(name: str, **parameters: Any) -> Policy:
    """The policy called `name`, made with `parameters`.

    Raises:
        UnknownNameError: no such policy, or it has no such parameter; the message lists the close ones.
    """
    policy = POLICIES.get(name)
    accepted = inspect.signature(policy).parameters
    for parameter in parameters:
        if parameter not in accepted:
            raise UnknownNameError(f"parameter of policy {name!r}", parameter, accepted)
    return policy(**parameters)


def parallel_env(name: str, **options: Any) -> CooperativeEnv:
    """The environment called `name`.

    Args:
        name: `crossing` (its newest version), `crossing-v0`, or the PettingZoo id `coopsim/crossing-v0`.
        **options: see `coopsim.envs.options` and the scenario's own numbers.

    Raises:
        UnknownNameError: no such environment or option; the message lists the close ones.
        InvalidValueError: an option's value is not accepted.
    """
    return ENVIRONMENTS.get(newest(name.removeprefix(f"{NAMESPACE}/")))(**options)


def newest(name: str) -> str:
    """`name` itself if it has a version or is unknown, else its newest version."""
    versions = [
        (int(match[1]), known) for known in ENVIRONMENTS if (match := re.fullmatch(re.escape(name) + r"-v(\d+)", known))
    ]
    return max(versions)[1] if versions else name
