"""Flags that several commands share, the parser, and exit statuses."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from coopsim.cli.argument_types import attacks, count, count_or_zero, named_value, numbers, seconds, seeds
from coopsim.errors import InvalidValueError, UnknownNameError, close_names

if TYPE_CHECKING:
    from coopsim.bench.grid.cell import CellResult

FAILED = 1
"""Exit status: the command ended, but some of its cells or policies failed."""

USER_ERROR = 2
"""Exit status: the user can correct the command, as for argparse's errors."""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells report it."""

POPULATION = ("vehicles", "connected_cars", "rsus", "drones", "pedestrians")
"""Options of a scenario that have a flag."""


class Command(NamedTuple):
    """A command: its line of help, its arguments, the function that runs it and returns the exit status, and examples
    for the end of its help.
    """

    help: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    examples: tuple[str, ...] = ()


class Parser(argparse.ArgumentParser):
    """A parser that suggests the option that was probably meant; it takes no abbreviations, which hide typos."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**(kwargs | {"allow_abbrev": False}))

    def error(self, message: str) -> NoReturn:
        """Exit with one line, which a screen of usage would hide."""
        self.exit(USER_ERROR, f"{self.prog}: error: {message} (see {self.prog} --help)\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        # Sub-commands are parsed here, never through parse_args. argparse would report a mistyped option as missing.
        for word in args or () if self._subparsers is None else ():
            option = str(word).split("=")[0]
            if option.startswith("--") and option not in self._option_string_actions:
                self.error(f"unknown option {option}. {self._meant(option)}")
        return super().parse_known_args(args, namespace)

    def _meant(self, option: str) -> str:
        """Suggest the close options, or list all where nothing is close. Old names are not suggested."""
        actions = self._option_string_actions.items()
        known = [name for name, each in actions if name.startswith("--") and each.help != argparse.SUPPRESS]
        close = close_names(option, known)
        return f"Did you mean {' or '.join(close)}?" if close else f"Accepted: {', '.join(known)}"


class _OldName(argparse.Action):
    """An option's old name: stores the value under the new one, and says so."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        note = f"{option_string} is now {self.metavar}; the old name works in this release only"
        print(f"coopsim: note: {note}", file=sys.stderr)
        setattr(namespace, self.dest, values)


def add_old_name(parser: argparse._ActionsContainer, old: str, new: argparse.Action, **changed: Any) -> None:
    """Accept an option's old name for a release, with a notice; `changed` are arguments in which it differs."""
    like = {"dest": new.dest, "type": new.type, "metavar": new.option_strings[0]}
    parser.add_argument(old, action=_OldName, help=argparse.SUPPRESS, default=argparse.SUPPRESS, **like | changed)


class _Unneeded(argparse.Action):
    """An option that does nothing any more: says so."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        print(f"coopsim: note: {option_string} is not needed: {self.metavar}", file=sys.stderr)


def add_unneeded(parser: argparse._ActionsContainer, name: str, why: str) -> None:
    """Accept a flag that does nothing any more for a release, with a notice that says why."""
    parser.add_argument(name, action=_Unneeded, nargs=0, metavar=why, help=argparse.SUPPRESS, default=argparse.SUPPRESS)


# fmt: off
_FLAGS: Mapping[str, Mapping[str, Any]] = {
    "--seeds": {"type": seeds, "metavar": "0-4", "help": "an episode each"},
    "--workers": {"type": count, "help": "at once (default: as many as cores)"},
    "--json": {"type": Path, "metavar": "PATH", "help": "write the numbers here as well"},
    "--detector": {"metavar": "NAME", "help": "name(parameter=value), see `list` (default: the environment's)"},
    "--device": {"default": "cpu", "metavar": "NAME",
                 "help": "of networks: cpu, cuda, cuda:1 or auto, a GPU if there is one (default: cpu)"},
    "--attack": {"type": attacks, "action": "append", "default": [], "metavar": "cav_1=ghost"},
    "--option": {"type": named_value, "action": "append", "default": [], "metavar": "NAME=VALUE"},
    "--dry-run": {"action": "store_true", "help": "run nothing but a few frames for timing; print what there is to "
                  "run, and the hours that it takes"},
    "--isolate": {"type": seconds, "nargs": "?", "const": 60.0, "metavar": "SECONDS", "help": "run each agent in a "
                  "process of its own, which gets its observations alone; time limit of a frame: 60 s"},
    # The name of a file would stand among the arguments, which every process may read.
    "--salt-fd": {"type": count_or_zero, "metavar": "N", "help": "open file with a secret that, with the seeds, "
                  "decides the episodes (16 bytes or more), as in `3< FILE`"},
    "--all-grids": {"action": "store_true",
                    "help": "results of all grids that were run into the folder, not of the latest alone"},
    "--position-noises-m": {"type": numbers, "metavar": "0,0.4", "help": "deviations of estimated x and y"},
    "--heading-noises-deg": {"type": numbers, "metavar": "0,0.4", "help": "of the estimated heading"},
    "--pose": {"choices": ("product", "together"), "help": "each position noise with each of heading, or pairs"},
}
# fmt: on
"""Flags that several commands have."""

NOISES = ("--position-noises-m", "--heading-noises-deg", "--pose")
"""Flags of the axes of pose noise."""


def add_flags(parser: argparse._ActionsContainer, *flags: str, **changed: Any) -> argparse.Action:
    """Declare flags that several commands have; `changed` are arguments in which they differ. Return the last one."""
    return [parser.add_argument(flag, **{**_FLAGS[flag], **changed}) for flag in flags][-1]


def add_options(parser: argparse._ActionsContainer, of: str) -> None:
    """Declare `--option name=value`, for options without a flag."""
    add_flags(parser, "--option", help=f"{of}; may be given several times")


def add_population(parser: argparse.ArgumentParser) -> None:
    """Declare the numbers of actors; the default is the scenario's."""
    for name in POPULATION:
        unit = "roadside units (default: the scenario's)" if name == "rsus" else "default: the scenario's"
        parser.add_argument(f"--{name.replace('_', '-')}", type=count_or_zero, help=unit)


def population(options: argparse.Namespace) -> dict[str, Any]:
    """Return the numbers of actors that were given."""
    return {name: value for name in POPULATION if (value := getattr(options, name)) is not None}


def detector_option(options: argparse.Namespace) -> dict[str, Any]:
    """Return the detector that was given by its flag, as an option of the environment."""
    return {} if options.detector is None else {"detector": options.detector}


def named_options(options: argparse.Namespace, flags: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return the options that were given by `--option`; `flags` are names that a flag must give instead, and the flag.

    Raises:
        InvalidValueError: an option is given twice, or must be given by a flag.
    """
    given: dict[str, Any] = {}
    for name, value in options.option:
        if name in given or (name in (*POPULATION, "detector") and getattr(options, name, None) is not None):
            raise InvalidValueError(f"{name} must be given once, got --option {name}={value} and another")
        if name in (flags or {}):
            raise InvalidValueError(f"{name} is not an option here: use {(flags or {})[name]}")
        given[name] = value
    return given


def without_flags(typed: str, flags: Mapping[str, int]) -> str:
    """Return a command, as in a shell, without some of its flags; `flags` is the number of words after each."""
    kept, skipped = [], 0
    for word in shlex.split(typed):
        name, equals, _ = word.partition("=")
        if skipped:
            skipped -= 1
        elif name in flags:
            skipped = 0 if equals else flags[name]
        else:
            kept.append(word)
    return shlex.join(kept)


def stored_results(folder: Path, hint: str = "", *, all_grids: bool = False) -> list[CellResult]:
    """Read the results in a folder of `coopsim bench`; `hint` ends the error where there is no such folder.

    They are of the latest grid, or of all grids that were run into the folder.

    Raises:
        UnknownNameError: there is no such folder of results; the message lists close ones next to it.
        InvalidValueError: the folder has no results.
    """
    from coopsim.bench.store.store import CELLS, Store

    if not (folder / CELLS).is_dir():
        siblings = folder.parent.iterdir() if folder.parent.is_dir() else ()
        known = [path.name for path in siblings if (path / CELLS).is_dir()]
        where = f"in {folder.parent}" + (f" ({hint})" if hint else "")
        raise UnknownNameError("folder of results", folder.name, known, where)
    results = Store(folder).results(all_grids=all_grids)
    if not results:
        raise InvalidValueError(f"there are no results in {folder}: run `coopsim bench` first")
    return results


def as_json(content: object) -> str:
    """Format content as indented JSON with a newline at the end."""
    return json.dumps(content, indent=2) + "\n"
