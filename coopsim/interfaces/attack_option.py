"""The option `attacks` of environments: who lies, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack import AttackOption, make_attack
from coopsim.support.user_code import names_code

AttacksOption = Mapping[str, AttackOption | Sequence[AttackOption]] | str | None
"""Attacks by agent, one or several each; the text of that, such as "cav_1=ghost(ahead_m=15) + rsu_0=remove"; or None:
all are honest."""

_ACCEPTED = 'a mapping of agents to attacks, or a text like "cav_1=ghost(ahead_m=15) + rsu_0=remove"'


def attacks_by_agent(option: AttacksOption, *, run_code: bool = True) -> dict[str, tuple[AttackOption, ...]]:
    """Return the attacks of each agent that lies.

    Each is tried, but without `run_code` not those that name code: the text may be a stranger's.

    Raises:
        InvalidValueError, UnknownNameError: it has another shape, or an attack is not accepted.
    """
    if option is None:
        return {}
    if isinstance(option, str):
        option = _read(option)
    if not isinstance(option, Mapping):
        raise InvalidValueError(f"attacks must be {_ACCEPTED}, got {option!r}")
    found: dict[str, tuple[AttackOption, ...]] = {}
    for agent, given in option.items():
        attacks = tuple(given) if isinstance(given, (list, tuple)) else (given,)
        if not (isinstance(agent, str) and agent and attacks):
            raise InvalidValueError(f"attacks must be {_ACCEPTED}, got {agent!r}: {given!r}")
        for each in attacks:
            if run_code or not (isinstance(each, str) and names_code(each)):
                make_attack(each)  # refused now, not at the first episode
        found[agent] = attacks
    return found


def spell_attacks(option: AttacksOption) -> str:
    """Return the option as one text, which reads the same; empty: all are honest. Errors as `attacks_by_agent`.

    It runs no code that the option names: texts in stored results are strangers'.
    """
    parts = []
    for agent, attacks in attacks_by_agent(option, run_code=False).items():
        for each in attacks:
            if not isinstance(each, str):
                raise InvalidValueError(f"attacks must be texts to be written down, got {each!r} for {agent}")
            parts.append(f"{agent}={each}")
    return " + ".join(parts)


def _read(text: str) -> dict[str, list[AttackOption]]:
    found: dict[str, list[AttackOption]] = {}
    for part in _split(text):
        agent, equals, attack = part.partition("=")
        if not (equals and agent.strip() and attack.strip()):
            raise InvalidValueError(f"attacks must be {_ACCEPTED}, got {part!r} in {text!r}")
        found.setdefault(agent.strip(), []).append(attack.strip())
    return found


def _split(text: str) -> list[str]:
    """Split a text at each + that is not within brackets; an empty text has no parts."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "+" and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts] if text.strip() else []
