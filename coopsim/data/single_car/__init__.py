"""Data sets of one car with sweeps: KITTI, Argoverse 2, nuScenes and plain arrays, one format a file.

The interface and its helpers are those of `coopsim.data.recordings`, whose `find_format` chooses among all formats.
"""
