"""Vehicles: where they start, how they drive, and how they replace each other."""
