"""The command line: a module for each command."""

from coopsim.cli.entry import main
from coopsim.cli.status import INTERRUPTED

__all__ = ["INTERRUPTED", "main"]
