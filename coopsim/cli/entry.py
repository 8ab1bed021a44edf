"""The entry of the command line: runs a command, and turns errors into one line and an exit status."""

from __future__ import annotations

import os
import shlex
import sys
import warnings
from collections.abc import Sequence

import coopsim
from coopsim.cli import (
    bench_command,
    check_export_command,
    compare_command,
    demo_command,
    detect_command,
    export_command,
    export_results_command,
    leaderboard_command,
    list_command,
    record_command,
    replay_command,
    report_command,
    town_command,
    train_command,
)
from coopsim.cli.arguments import INTERRUPTED, USER_ERROR, Parser
from coopsim.errors import CoopsimError
from coopsim.support.interrupts import repeated_interrupts

_COMMANDS = {
    "demo": demo_command,
    "bench": bench_command,
    "detect": detect_command,
    "report": report_command,
    "compare": compare_command,
    "record": record_command,
    "town": town_command,
    "export": export_command,
    "check-export": check_export_command,
    "export-results": export_results_command,
    "train": train_command,
    "replay": replay_command,
    "leaderboard": leaderboard_command,
    "list": list_command,
}
"""Modules with `HELP`, `add_arguments` and `run`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command. Return its exit status: 0, `FAILED`, `USER_ERROR` or `INTERRUPTED`."""
    typed = sys.argv[1:] if arguments is None else arguments
    options = make_parser().parse_args(typed)
    options.typed = shlex.join(["coopsim", *typed])
    usual_format, warnings.formatwarning = warnings.formatwarning, _warning_in_one_line
    try:
        with repeated_interrupts():
            return int(options.command(options))
    except CoopsimError as error:
        print(f"coopsim: error: {error}", file=sys.stderr)
        return USER_ERROR
    except KeyboardInterrupt:
        print("coopsim: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output ended, as `head` does
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  (so that the exit does not flush into the pipe)
        return 0
    finally:
        warnings.formatwarning = usual_format


def _warning_in_one_line(message: Warning | str, *_: object, **__: object) -> str:
    """Format a warning without its place in the library, which means nothing to the user of a command."""
    return f"coopsim: warning: {message}\n"


def make_parser() -> Parser:
    """Make the parser of all commands; a parsed line has its `command` to run."""
    parser = Parser(prog="coopsim", description="The gym for cooperative perception.")
    parser.add_argument("--version", action="version", version=f"coopsim {coopsim.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)
    for name, command in _COMMANDS.items():
        subparser = commands.add_parser(name, help=command.HELP)
        command.add_arguments(subparser)
        subparser.set_defaults(command=command.run)
    return parser
