"""The word "all" in a list of policies: every registered policy whose weights ship."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from coopsim.bench.policy_spec import PolicySpec
from coopsim.catalog import POLICIES
from coopsim.errors import WeightsNotShippedError

ALL = "all"


def name_all(policies: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Replace "all" in a list of policies; the others stay as they are.

    It stands for every registered policy, those of installed packages among them, as it is by default. Left out are
    those that the list names itself, with whatever parameters, and those whose weights do not ship.

    Returns:
        The list, and the policies whose weights do not ship, with the reason.

    Raises:
        UnknownNameError: the list has "all", and a policy that is not registered.
        MissingDependencyError: the list has "all", and a policy needs a package that is not installed.
    """
    if ALL not in policies:
        return tuple(policies), {}
    named = {PolicySpec.parse(policy).policy_class() for policy in policies if policy != ALL}
    reasons = {name: _reason(name) for name in POLICIES.names() if POLICIES.get(name) not in named}
    rest = [name for name, reason in reasons.items() if not reason]
    place = policies.index(ALL)
    made = (*policies[:place], *rest, *policies[place + 1 :])
    return made, {name: reason for name, reason in reasons.items() if reason}


@cache
def _reason(name: str) -> str:
    """Return why a policy has no weights; empty where it has all it needs."""
    try:
        PolicySpec(name).make()
    except WeightsNotShippedError as error:
        return str(error)
    return ""
