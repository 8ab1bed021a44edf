"""Simulated environments: options, scenario files, and the frames that sensors make of a world."""
