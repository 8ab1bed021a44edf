"""Formats of observations and actions: gymnasium spaces, and typed structs to dicts of arrays and back.

Input is `Observation`s and `Tracks`; output is what any PettingZoo tool reads. Start with `observation_format.py`.
"""
