"""Recordings of others: folders come in, frames with sweeps, poses, labels and pictures go out, read when asked for.

Start reading in `recorded_folder`, the interface; `find_format` chooses its subclass, of which each format is a file;
`recorded_scene` makes frames look as those of the simulation.
"""
