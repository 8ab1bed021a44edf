"""Surroundings as in real streets: what stands over, beside and before objects, and people and vehicles at rest.

`street.py` composes a street around a layout that has furniture, from the compositions in `compositions.py` and the
parked vehicles in `parking.py`; `draft.py` keeps a composition's items apart, and `cast.py` chooses who is in it.
"""
