"""Engine of a benchmark: jobs go in, outcomes come out of processes of this machine or of Ray.

Start at `Engine` in `engine.py`; `job.py` is what runs in a worker, for one cell.
"""
