"""Exports: episodes of simulated environments as folders in the formats of data sets."""
