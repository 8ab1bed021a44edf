"""Recorded worlds: the same traffic for every policy."""
