"""Entries of the leaderboard: folders with a policy, its card and its scores, checked by one command.

Start at `entry_folder.py`; then `fixed_run.py`, `entry_checks.py`, `entry_page.py`.
"""
