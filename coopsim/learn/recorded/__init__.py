"""Trainings on recordings: clips of sweeps; windows of detections, their tracks, and the losses of a filter."""
