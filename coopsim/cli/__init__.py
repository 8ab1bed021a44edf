"""The command line: a module for each command."""

from coopsim.cli.arguments import INTERRUPTED
from coopsim.cli.entry import main

__all__ = ["INTERRUPTED", "main"]
