"""Helpers without knowledge of cooperative perception: checks, arrays, random streams, registries, files, kernels.

Every other room may import this one, and it imports none but `coopsim.errors`. Start with `checks.py` and `arrays.py`.
"""
