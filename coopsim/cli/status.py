"""What commands return to the shell."""

FAILED_CELLS = 1
"""A benchmark came to its end, and some of its cells failed."""

USER_ERROR = 2
"""The user can mend it; argparse has it for unknown options, too."""

INTERRUPTED = 130
"""Ctrl-C, as shells report it."""
