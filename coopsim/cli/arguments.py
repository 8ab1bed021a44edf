"""Arguments that several commands share, and exit statuses."""

from __future__ import annotations

import argparse
import difflib
import itertools
import json
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import yaml

from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.support.checks import as_runs

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
        close = difflib.get_close_matches(option, known, n=2, cutoff=0.5)
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


def add_population(parser: argparse.ArgumentParser) -> None:
    """Declare the numbers of actors; the default is the scenario's."""
    add = parser.add_argument
    for name in POPULATION:
        unit = "roadside units (default: the scenario's)" if name == "rsus" else "default: the scenario's"
        add(f"--{name.replace('_', '-')}", type=count_or_zero, help=unit)


def population(options: argparse.Namespace) -> dict[str, Any]:
    """Return the numbers of actors that were given."""
    return {name: value for name in POPULATION if (value := getattr(options, name)) is not None}


def names(text: str) -> tuple[str, ...]:
    """Parse distinct names with commas between them."""
    named = tuple(name.strip() for name in text.split(","))
    if not all(named) or len(set(named)) < len(named):
        raise argparse.ArgumentTypeError(f"must be distinct names with commas between them, got {text!r}")
    return named


def policy(text: str) -> str:
    """Parse a policy. Return its one spelling."""
    from coopsim.catalog import PolicySpec

    try:
        return PolicySpec.parse(text).text
    except CoopsimError as error:  # argparse hides the text of other exceptions
        raise argparse.ArgumentTypeError(str(error)) from error


def policies(text: str) -> tuple[str, ...]:
    """Parse distinct policies with commas between them; commas in brackets belong to parameters."""
    from coopsim.config.spec import split_specs

    found = tuple(policy(part) for part in split_specs(text))
    if len(set(found)) < len(found):
        raise argparse.ArgumentTypeError(f"must be distinct policies, got {text!r}")
    return found


def add_options(parser: argparse._ActionsContainer, of: str) -> None:
    """Declare `--option name=value`, for options without a flag."""
    metavar, several = "NAME=VALUE", "may be given several times"
    parser.add_argument(
        "--option", type=named_value, action="append", default=[], metavar=metavar, help=f"{of}; {several}"
    )


def add_noises(parser: argparse._ActionsContainer, of: str = "") -> None:
    """Declare the axes of pose noise; `of` ends their help."""
    add, metavar = parser.add_argument, "0,0.4"
    add("--position-noises-m", type=numbers, metavar=metavar, help=f"standard deviations of estimated x and y{of}")
    add("--heading-noises-deg", type=numbers, metavar=metavar, help=f"of the estimated heading{of}")
    add("--pose", choices=("product", "together"), help="each position noise with each of heading (default), or pairs")


def add_detector(parser: argparse._ActionsContainer) -> None:
    """Declare `--detector`, which `--option detector=...` gives as well."""
    text = "name(parameter=value), see `list` (default: the environment's)"
    parser.add_argument("--detector", metavar="NAME", help=text)


def detector_option(options: argparse.Namespace) -> dict[str, Any]:
    """Return the detector that was given by its flag, as an option of the environment."""
    return {} if options.detector is None else {"detector": options.detector}


def add_device(parser: argparse._ActionsContainer, default: str | None = "cpu") -> None:
    """Declare `--device`; None stands for the processor, or for the value of a file."""
    text = f"of networks: cpu, cuda, cuda:1 or auto, a GPU if there is one (default: {default or 'cpu'})"
    parser.add_argument("--device", default=default, metavar="NAME", help=text)


def add_dry_run(parser: argparse._ActionsContainer) -> None:
    """Declare `--dry-run`."""
    text = "run nothing but a few frames for timing; print what there is to run, and the hours that it takes"
    parser.add_argument("--dry-run", action="store_true", help=text)


def add_isolate(parser: argparse._ActionsContainer) -> None:
    """Declare `--isolate`."""
    parser.add_argument(
        "--isolate",
        type=seconds,
        nargs="?",
        const=60.0,
        metavar="SECONDS",
        help="run each agent in a process of its own, which gets its observations alone; time limit of a frame: 60 s",
    )


def add_isolation(parser: argparse._ActionsContainer) -> None:
    """Declare `--isolate` and `--salt-fd`."""
    add_isolate(parser)
    add_salt(parser)


def add_salt(parser: argparse._ActionsContainer) -> None:
    """Declare `--salt-fd`. The name of a file would stand among the arguments, which every process may read."""
    parser.add_argument(
        "--salt-fd",
        type=count_or_zero,
        metavar="N",
        help="open file with a secret that, with the seeds, decides the episodes (16 bytes or more), as in `3< FILE`",
    )


def seconds(text: str) -> float:
    """Parse a positive number of seconds."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number of seconds > 0, got {text!r}")
    return value


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


def attacks(text: str) -> str:
    """Parse attacks of agents, as `cav_1=ghost(ahead_m=15) + rsu_0=remove`, or `none`. Return their one spelling."""
    from coopsim.interfaces.attack_option import spell_attacks

    try:
        return "" if text == "none" else spell_attacks(text)
    except CoopsimError as error:  # argparse hides the text of other exceptions
        raise argparse.ArgumentTypeError(str(error)) from error


def add_attack(parser: argparse._ActionsContainer, of: str) -> None:
    """Declare `--attack AGENT=ATTACK`."""
    parser.add_argument("--attack", type=attacks, action="append", default=[], metavar="cav_1=ghost", help=of)


def numbers(text: str) -> tuple[float, ...]:
    """Parse numbers with commas between them."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers with commas between them, got {text!r}") from None


def seeds(text: str) -> tuple[int, ...]:
    """Parse integers >= 0 with commas between them; `0-4` is five of them."""
    ranges: list[range] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        ends = first, last if dash else first
        if not all(end.strip().isdecimal() for end in ends) or int(ends[1]) < int(ends[0]):
            raise argparse.ArgumentTypeError(f"must be integers >= 0 with commas between them, or 0-4, got {text!r}")
        ranges.append(range(int(ends[0]), int(ends[1]) + 1))
    try:
        return as_runs(seeds=itertools.chain.from_iterable(ranges))
    except InvalidValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def named_value(text: str) -> tuple[str, Any]:
    """Parse `name=value`, the value as YAML."""
    name, equals, value = text.partition("=")
    try:
        if not (name and equals):
            raise ValueError
        return name.strip(), yaml.safe_load(value)
    except (ValueError, yaml.YAMLError):
        raise argparse.ArgumentTypeError(f"must be name=value, the value as YAML has it, got {text!r}") from None


WAYS = ("product", "one_by_one")
"""Words of `--vary`: the ways in which axes are combined."""


def varied_option(text: str) -> str | tuple[str, tuple[Any, ...]]:
    """Parse `name=value,value`, values as YAML, or one of `WAYS`; commas in brackets belong to a value."""
    from coopsim.config.spec import split_specs

    name, equals, values = text.partition("=")
    if text in WAYS:
        return text
    if not (equals and name.strip()):
        raise argparse.ArgumentTypeError(f"must be {', '.join(WAYS)} or an option as name=value,value, got {text!r}")
    return name.strip(), tuple(named_value(f"{name}={value}")[1] for value in split_specs(values))


def varied(given: Iterable[str | tuple[str, tuple[Any, ...]]]) -> dict[str, Any]:
    """Return what `--vary` gave, as attributes of a grid: None where it gave none.

    Raises:
        InvalidValueError: an axis, or the way to combine them, is given twice.
    """
    words, named = (
        [each for each in given if isinstance(each, str)],
        [each for each in given if isinstance(each, tuple)],
    )
    axes = dict(named)
    if len(words) > 1 or len(axes) < len(named):
        raise InvalidValueError(f"--vary must be given once for each option and once for {' or '.join(WAYS)}")
    return {"vary": words[0] if words else None, "axes": axes or None}


def count_or_zero(text: str) -> int:
    """Parse an integer >= 0."""
    return _integer(text, least=0)


def count(text: str) -> int:
    """Parse an integer >= 1."""
    return _integer(text, least=1)


def _integer(text: str, least: int) -> int:
    if not (text.isdecimal() and int(text) >= least):
        raise argparse.ArgumentTypeError(f"must be an integer >= {least}, got {text!r}")
    return int(text)


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


def add_all_grids(parser: argparse._ActionsContainer) -> None:
    """Declare `--all-grids`."""
    text = "results of all grids that were run into the folder, not of the latest alone"
    parser.add_argument("--all-grids", action="store_true", help=text)


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
