"""Simulated detectors: they look at the truth, as far as the sensors' returns support it."""
