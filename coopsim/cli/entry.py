"""The entry of the command line: runs a command, and turns errors into one line and an exit status."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import warnings
from collections.abc import Sequence

import coopsim
from coopsim.cli.arguments import INTERRUPTED, USER_ERROR, Command, Parser
from coopsim.cli.bench_commands import BENCH, COMPARE, REPORT
from coopsim.cli.clip_command import CLIP
from coopsim.cli.completion_command import COMPLETION
from coopsim.cli.demo_command import DEMO
from coopsim.cli.detect_command import DETECT
from coopsim.cli.entry_commands import ENTRY
from coopsim.cli.export_commands import CHECK_EXPORT, EXPORT, EXPORT_RESULTS
from coopsim.cli.info_command import INFO
from coopsim.cli.list_command import LIST
from coopsim.cli.log_command import LOG
from coopsim.cli.map_command import MAP
from coopsim.cli.paste_command import PASTE
from coopsim.cli.recordings_commands import LEADERBOARD, REPLAY
from coopsim.cli.train_command import TRAIN
from coopsim.cli.world_commands import RECORD, TOWN
from coopsim.errors import CoopsimError, PlugInError
from coopsim.support.interrupts import repeated_interrupts
from coopsim.support.printable import printable
from coopsim.support.registry import Registry

_COMMANDS = {
    "demo": DEMO,
    "list": LIST,
    "info": INFO,
    "bench": BENCH,
    "detect": DETECT,
    "report": REPORT,
    "compare": COMPARE,
    "clip": CLIP,
    "record": RECORD,
    "town": TOWN,
    "log": LOG,
    "map": MAP,
    "export": EXPORT,
    "check-export": CHECK_EXPORT,
    "export-results": EXPORT_RESULTS,
    "train": TRAIN,
    "paste": PASTE,
    "replay": REPLAY,
    "leaderboard": LEADERBOARD,
    "entry": ENTRY,
    "completion": COMPLETION,
}

COMMANDS: Registry[Command] = Registry("command", group="coopsim.commands")
"""Commands by name. Installed packages add theirs through the entry-point group `coopsim.commands`."""

for _name, _command in _COMMANDS.items():
    COMMANDS.register(_name)(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command. Return its exit status: 0, `FAILED`, `USER_ERROR` or `INTERRUPTED`."""
    typed = sys.argv[1:] if arguments is None else arguments
    usual_format, warnings.formatwarning = warnings.formatwarning, _warning_in_one_line
    try:
        options = make_parser(typed).parse_args(typed)
        options.typed = shlex.join(["coopsim", *typed])
        with repeated_interrupts():
            return int(options.command(options))
    except CoopsimError as error:
        print(f"coopsim: error: {printable(str(error), chr(10))}", file=sys.stderr)
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


def make_parser(typed: Sequence[str] = ()) -> Parser:
    """Make the parser of all commands; a parsed line has its `command` to run.

    Of the commands of installed packages only the `typed` one is loaded, so that a broken one costs itself alone.
    """
    parser = Parser(prog="coopsim", description="The gym for cooperative perception.")
    parser.set_defaults(parser=parser)
    parser.add_argument("--version", action="version", version=f"coopsim {coopsim.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)
    word = next((word for word in typed if not word.startswith("-")), None)
    for name in (*_COMMANDS, *(name for name in COMMANDS if name not in _COMMANDS)):
        if name != word and name not in _COMMANDS:
            commands.add_parser(name, help=COMMANDS.source_of(name))
            continue
        command = _COMMANDS[name] if name in _COMMANDS else COMMANDS.get(name)
        if not isinstance(command, Command):
            raise PlugInError(f"{COMMANDS.source_of(name)} must be a coopsim.cli.arguments.Command, got {command!r}")
        subparser = commands.add_parser(
            name,
            help=command.help,
            description=f"{command.help[0].upper()}{command.help[1:]}.",
            epilog="\n".join(("examples:", *(f"  {line}" for line in command.examples))),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(subparser)
        subparser.set_defaults(command=command.run)
    return parser
