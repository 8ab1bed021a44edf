"""Data sets of one car with sweeps: KITTI, Argoverse 2, nuScenes and plain arrays, one format a file.

The interface is `coopsim.recordings`; helpers are those of `coopsim.data.recordings`.
"""
