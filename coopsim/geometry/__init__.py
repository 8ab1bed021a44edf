"""Rigid transforms and rotated boxes."""
