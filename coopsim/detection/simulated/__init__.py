"""Simulated detectors: the truth, thinned and disturbed by models of misses, errors and false positives.

Input is the actors around each agent with their numbers of LiDAR returns; output is `Detections`. Start with
`correlated.py`, the detector fitted to recordings, whose errors persist; `simulated.py` errs anew in every frame.
"""
