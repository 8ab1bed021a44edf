"""The command line: arguments go in; calls of the library, printed tables and an exit status come out.

Start at `main` in `entry.py`; each command is a `Command` in a module with its kin.
"""

from coopsim.cli.arguments import INTERRUPTED
from coopsim.cli.entry import main

__all__ = ["INTERRUPTED", "main"]
