"""What commands return to the shell."""

FAILED = 1
"""It came to its end, and some of what it ran failed: cells of a benchmark, policies of a leaderboard."""

USER_ERROR = 2
"""The user can mend it; argparse has it for unknown options, too."""

INTERRUPTED = 130
"""Ctrl-C, as shells report it."""
