"""Vehicles: where they start, and the engines that move them."""
