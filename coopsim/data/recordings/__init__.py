"""Data sets of several agents with sweeps, one format a file; their interface is `coopsim.recordings`."""

from coopsim.support.moved import moved

moved(f"{__name__}.find_format", "coopsim.recordings.formats")
