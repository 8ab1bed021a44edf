"""Situations: seconds before a crash that one car, the ego, can avoid if it knows in time what it cannot see.

In: a place and a seed. Out: a `Script` (`coopsim/world/script.py`), which says who drives and walks where. Start
reading at `situation.py`.
"""
