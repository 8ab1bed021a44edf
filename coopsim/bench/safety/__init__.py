"""Crashes in a benchmark of situations: rates, what messages and lies change, and clips of pairs of runs for a talk.

In: results whose cars were driven by a planner. Out: tables, figures, pictures. Start at `safety_text.py`, which
counts, or at `pair_clip.py`, which draws.
"""
