"""Vehicles: who starts where, and the engines that move them."""
