"""Recordings of other people as sequences of frames: sweeps, poses, labels and pictures, read when asked for."""
