"""Detectors that are simulated: the truth, thinned and disturbed."""
