"""Trainings on recordings: windows of them, the tracks in a window, the losses of a filter on these."""
