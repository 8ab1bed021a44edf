"""Types of arguments: a text goes in, a value or argparse's error comes out."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import yaml

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.support.checks import as_runs

T = TypeVar("T")


def accepting(accepted: str) -> Callable[[Callable[[str], T]], Callable[[str], T]]:
    """Return a decorator that makes a parser a type of arguments, whose errors argparse shows.

    A `ValueError` means that the text is not what is `accepted`; an error of coopsim says itself what is wrong.
    """

    def decorate(parse: Callable[[str], T]) -> Callable[[str], T]:
        def parsed(text: str) -> T:
            try:
                return parse(text)
            except CoopsimError as error:  # argparse hides the text of other exceptions
                reason = str(error)
            except (ValueError, yaml.YAMLError):
                reason = f"must be {accepted}, got {text!r}"
            raise argparse.ArgumentTypeError(reason)

        return parsed

    return decorate


def _which(value: T, accepted: bool) -> T:
    """Return a value that is accepted; raise `ValueError` for another."""
    if not accepted:
        raise ValueError
    return value


@accepting("distinct names with commas between them")
def names(text: str) -> tuple[str, ...]:
    """Parse distinct names with commas between them."""
    named = tuple(name.strip() for name in text.split(","))
    return _which(named, all(named) and len(set(named)) == len(named))


@accepting("distinct environments")
def environments(text: str) -> tuple[str, ...]:
    """Parse distinct environments with commas between them; commas in brackets belong to options."""
    from coopsim.config.spec import split_specs

    found = split_specs(text)
    return _which(found, all(found) and len(set(found)) == len(found))


@accepting("a policy")
def policy(text: str) -> str:
    """Parse a policy. Return its one spelling."""
    from coopsim.catalog import PolicySpec

    return PolicySpec.parse(text).text


@accepting("distinct policies")
def policies(text: str) -> tuple[str, ...]:
    """Parse distinct policies with commas between them; commas in brackets belong to parameters."""
    from coopsim.config.spec import split_specs

    found = tuple(policy(part) for part in split_specs(text))
    return _which(found, len(set(found)) == len(found))


@accepting("attacks")
def attacks(text: str) -> str:
    """Parse attacks of agents, as `cav_1=ghost(ahead_m=15) + rsu_0=remove`, or `none`. Return their one spelling."""
    from coopsim.interfaces.attack_option import spell_attacks

    return "" if text == "none" else spell_attacks(text)


@accepting("a number of seconds > 0")
def seconds(text: str) -> float:
    """Parse a positive number of seconds."""
    return _which(float(text), 0.0 < float(text) < math.inf)


@accepting("numbers with commas between them")
def numbers(text: str) -> tuple[float, ...]:
    """Parse numbers with commas between them."""
    return tuple(float(part) for part in text.split(","))


@accepting("pairs m/degrees with commas between, as 0/0,0.4/0.4")
def noises(text: str) -> tuple[tuple[float, float], ...]:
    """Parse pairs of metres and degrees, "0/0,0.4/0.4"."""
    return tuple((float(m), float(deg)) for m, deg in (part.split("/") for part in text.split(",")))


@accepting("integers >= 0 with commas between them, or 0-4")
def seeds(text: str) -> tuple[int, ...]:
    """Parse integers >= 0 with commas between them; `0-4` is five of them."""
    ranges: list[range] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        ends = first, last if dash else first
        known = all(end.strip().isdecimal() for end in ends) and int(ends[1]) >= int(ends[0])
        ranges.append(_which(range(int(ends[0]), int(ends[1]) + 1), known))
    return as_runs(seeds=itertools.chain.from_iterable(ranges))


@accepting("name=value, the value as YAML has it")
def named_value(text: str) -> tuple[str, Any]:
    """Parse `name=value`, the value as YAML."""
    name, equals, value = text.partition("=")
    return _which(name.strip(), bool(name and equals)), yaml.safe_load(value)


WAYS = ("product", "one_by_one")
"""Words of `--vary`: the ways in which axes are combined."""


@accepting(f"{', '.join(WAYS)} or an option as name=value,value")
def varied_option(text: str) -> str | tuple[str, tuple[Any, ...]]:
    """Parse `name=value,value`, values as YAML, or one of `WAYS`; commas in brackets belong to a value."""
    from coopsim.config.spec import split_specs

    name, equals, values = text.partition("=")
    if text in WAYS:
        return text
    named = _which(name.strip(), bool(equals and name.strip()))
    return named, tuple(named_value(f"{name}={value}")[1] for value in split_specs(values))


def varied(given: Iterable[str | tuple[str, tuple[Any, ...]]]) -> dict[str, Any]:
    """Return what `--vary` gave, as attributes of a grid: None where it gave none.

    Raises:
        InvalidValueError: an axis, or the way to combine them, is given twice.
    """
    given = list(given)
    words, named = [each for each in given if isinstance(each, str)], [each for each in given if each not in WAYS]
    axes: dict[str, Any] = dict(named)  # type: ignore[arg-type]
    if len(words) > 1 or len(axes) < len(named):
        raise InvalidValueError(f"--vary must be given once for each option and once for {' or '.join(WAYS)}")
    return {"vary": words[0] if words else None, "axes": axes or None}


def _at_least(least: int) -> Callable[[str], int]:
    parsed = accepting(f"an integer >= {least}")
    return parsed(lambda text: _which(int(text) if text.isdecimal() else -1, text.isdecimal() and int(text) >= least))


count, count_or_zero = _at_least(1), _at_least(0)
