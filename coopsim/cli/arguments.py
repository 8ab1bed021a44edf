"""What several commands read from the command line."""

from __future__ import annotations

import argparse
import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import yaml

from coopsim.cli.status import USER_ERROR
from coopsim.errors import CoopsimError, InvalidValueError

POPULATION = ("vehicles", "connected_cars", "rsus", "drones", "pedestrians")
"""Numbers that have a flag."""


class Parser(argparse.ArgumentParser):
    """Suggests the option that was probably meant; takes no abbreviations, which hide typos."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**(kwargs | {"allow_abbrev": False}))

    def error(self, message: str) -> NoReturn:
        """One line: what was wrong should not be lost below a screen of usage."""
        self.exit(USER_ERROR, f"{self.prog}: error: {message} (see {self.prog} --help)\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        # A sub-command's parser is asked here, never through parse_args. Before argparse, which would rather complain
        # that the option which was mistyped is missing.
        for word in args or () if self._subparsers is None else ():
            option = str(word).split("=")[0]
            if option.startswith("--") and option not in self._option_string_actions:
                close = difflib.get_close_matches(option, self._option_string_actions, n=2, cutoff=0.5)
                hint = f" Did you mean {' or '.join(close)}?" if close else ""
                accepted = ", ".join(name for name in self._option_string_actions if name.startswith("--"))
                self.error(f"unknown option {option}.{hint} Accepted: {accepted}")
        return super().parse_known_args(args, namespace)


def add_population(parser: argparse.ArgumentParser) -> None:
    """Numbers of actors; whichever is not given is the scenario's own."""
    add = parser.add_argument
    add("--vehicles", type=count_or_zero, help="default: the scenario's own")
    add("--connected-cars", type=count_or_zero, help="default: the scenario's own")
    add("--rsus", type=count_or_zero, help="roadside units (default: the scenario's own)")
    add("--drones", type=count_or_zero, help="default: the scenario's own")
    add("--pedestrians", type=count_or_zero, help="default: the scenario's own")


def population(options: argparse.Namespace) -> dict[str, Any]:
    """Numbers of the scenario that the user named."""
    return {name: value for name in POPULATION if (value := getattr(options, name)) is not None}


def add_recordings(parser: argparse.ArgumentParser) -> None:
    """A recording set and how its messages travel."""
    add = parser.add_argument
    add("path", type=Path, help="folder with labels/ and detections/<name>/")
    add(
        "--detections",
        type=names,
        required=True,
        metavar="A,B",
        help="every name is one agent, first the one in whose frame the boxes are",
    )
    add("--latency-ms", type=float, default=0.0, help="of every message (default: %(default)s)")
    add("--match-iou", type=float, default=0.25, help="3D IoU of a match (default: %(default)s)")


def names(text: str) -> tuple[str, ...]:
    """Distinct names with commas between them."""
    named = tuple(name.strip() for name in text.split(","))
    if not all(named) or len(set(named)) < len(named):
        raise argparse.ArgumentTypeError(f"must be distinct names with commas between them, got {text!r}")
    return named


def policy(text: str) -> str:
    """A policy as `PolicySpec` reads it, in its one spelling."""
    from coopsim.bench.policy_spec import PolicySpec

    try:
        return PolicySpec.parse(text).text
    except CoopsimError as error:  # argparse would hide what it says
        raise argparse.ArgumentTypeError(str(error)) from error


def policies(text: str) -> tuple[str, ...]:
    """Distinct policies with commas between them; commas in brackets belong to parameters."""
    from coopsim.config.spec import split_specs

    found = tuple(policy(part) for part in split_specs(text))
    if len(set(found)) < len(found):
        raise argparse.ArgumentTypeError(f"must be distinct policies, got {text!r}")
    return found


def add_options(parser: argparse._ActionsContainer, of: str) -> None:
    """Whatever has no flag of its own, by `--option name=value`."""
    metavar, several = "NAME=VALUE", "may be given several times"
    parser.add_argument(
        "--option", type=named_value, action="append", default=[], metavar=metavar, help=f"{of}; {several}"
    )


def named_options(options: argparse.Namespace, flags: Mapping[str, str] | None = None) -> dict[str, Any]:
    """What was said by `--option`, by name.

    Args:
        options: the command's.
        flags: by what such options are to be said instead, by name.

    Raises:
        InvalidValueError: a name is given twice, or is that of a flag.
    """
    given: dict[str, Any] = {}
    for name, value in options.option:
        if name in given or (name in POPULATION and getattr(options, name, None) is not None):
            raise InvalidValueError(f"{name} must be given once, got --option {name}={value} beside another")
        if name in (flags or {}):
            raise InvalidValueError(f"{name} is none of the options: say it by {(flags or {})[name]}")
        given[name] = value
    return given


def numbers(text: str) -> tuple[float, ...]:
    """Numbers with commas between them."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers with commas between them, got {text!r}") from None


def seeds(text: str) -> tuple[int, ...]:
    """Integers >= 0 with commas between them; `0-4` is five of them."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        ends = first, last or first
        if not all(end.strip().isdecimal() for end in ends) or int(ends[1]) < int(ends[0]):
            raise argparse.ArgumentTypeError(f"must be integers >= 0 with commas between them, or 0-4, got {text!r}")
        found += range(int(ends[0]), int(ends[1]) + 1)
    return tuple(found)


def named_value(text: str) -> tuple[str, Any]:
    """`name=value`, the value as YAML has it."""
    name, equals, value = text.partition("=")
    try:
        if not (name and equals):
            raise ValueError
        return name.strip(), yaml.safe_load(value)
    except (ValueError, yaml.YAMLError):
        raise argparse.ArgumentTypeError(f"must be name=value, the value as YAML has it, got {text!r}") from None


def count_or_zero(text: str) -> int:
    """An integer >= 0."""
    return _integer(text, least=0)


def count(text: str) -> int:
    """An integer >= 1."""
    return _integer(text, least=1)


def _integer(text: str, least: int) -> int:
    if not (text.isdecimal() and int(text) >= least):
        raise argparse.ArgumentTypeError(f"must be an integer >= {least}, got {text!r}")
    return int(text)


def as_json(content: object) -> str:
    """Indented, with a newline at the end."""
    return json.dumps(content, indent=2) + "\n"
