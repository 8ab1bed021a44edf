"""What commands return to the shell."""

USER_ERROR = 2
"""The user can mend it; argparse has it for unknown options, too."""

INTERRUPTED = 130
"""Ctrl-C, as shells report it."""
