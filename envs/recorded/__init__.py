"""Replays of recordings with sweeps."""
