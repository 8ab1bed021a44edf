"""Crashes in a benchmark of situations: rates, pairs of runs with and without messages, and clips of them.

In: results whose cars were driven by a planner. Out: tables, sections of the report, pictures. Start at `recording.py`,
which records a run from above, or at `crash_rates.py`, which counts.
"""
