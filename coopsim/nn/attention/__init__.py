"""Attention over agents and places, of which fusions are built."""
