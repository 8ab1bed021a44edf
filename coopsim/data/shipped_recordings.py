"""The formats of recordings that come along. Importing registers them."""

from coopsim.data.recordings import opv2v_folder, spd_folder, v2v4real_folder
from coopsim.data.single_car import (
    argoverse2_folder,
    array_folder,
    kitti_object_folder,
    kitti_tracking_folder,
    nuscenes_folder,
)

__all__ = [
    "argoverse2_folder",
    "array_folder",
    "kitti_object_folder",
    "kitti_tracking_folder",
    "nuscenes_folder",
    "opv2v_folder",
    "spd_folder",
    "v2v4real_folder",
]
