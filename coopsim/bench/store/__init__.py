"""Store of a benchmark: results of finished cells go in and come out, by the key of all that decided them.

Start at `Store` in `store.py`; `fingerprint.py` makes the key.
"""
