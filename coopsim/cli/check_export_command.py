"""`coopsim check-export`."""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

from coopsim.cli.arguments import FAILED

HELP = "check a folder that `export` wrote, or another one in such a format"

_MOST = 100
"""Problems that are printed: a wrong folder can have one in every file."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="what `export` wrote")
    parser.add_argument("--format", help="check this format alone, in a folder that coopsim need not have written")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.data.export.export_checks import check_export

    problems = list(islice(check_export(options.folder, options.format), _MOST + 1))
    for problem in problems[:_MOST]:
        print(problem)
    if problems:
        count = f"more than {_MOST}" if len(problems) > _MOST else str(len(problems))
        print(f"{count} problem{'s' * (len(problems) > 1)}")
        return FAILED
    print(f"{options.folder} is as it should be")
    return 0
