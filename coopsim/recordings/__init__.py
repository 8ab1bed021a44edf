"""Recordings of others: folders come in, frames with sweeps, poses, labels and pictures go out, read when asked for.

Start reading in `recorded_folder`, the interface; `formats` chooses its subclass by name or by a look, of which each
format is a file in `coopsim.data`; `recorded_scene` makes frames look as those of the simulation.
"""
