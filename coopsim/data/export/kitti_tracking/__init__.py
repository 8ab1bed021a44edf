"""Exports as sequences of KITTI's tracking benchmark."""
