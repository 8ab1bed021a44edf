"""Benchmarks: policies, conditions and seeds go in; scores, statistics, reports and files for papers come out.

Start at `benchmark.py` for a grid of simulated runs, at `evaluate.py` for one run, at `leaderboard.py` for recordings,
and at `detect/` for average precision. The folders follow the data: `grid`, `engine`, `store`, `results`, `report`.
"""
