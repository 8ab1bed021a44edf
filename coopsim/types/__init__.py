"""The data that flows between the parts, as frozen structs of arrays.

Box order is x, y, z, l, w, h, yaw everywhere. Times are integer nanoseconds since the episode's start.
Shapes are checked when an object is made; values (finite, positive) where they enter from outside.
"""

from coopsim.types.estimates import Detections, GroundTruth, Tracks
from coopsim.types.features import BevGrid, FeatureMap, InstanceQueries, PointCloud
from coopsim.types.messages import AgentSpec, Message, Observation
from coopsim.types.sensing import (
    CameraCalibration,
    CameraImage,
    LidarMounting,
    Odometry,
    PoseEstimate,
    SensorView,
    Sweep,
    stack_xyz_yaw,
)
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass
from coopsim.types.units import NS_PER_S, Ints, Mask, seconds_to_ns

__all__ = [
    "CLASS_NAMES",
    "NS_PER_S",
    "AgentSpec",
    "BevGrid",
    "CameraCalibration",
    "CameraImage",
    "Detections",
    "FeatureMap",
    "GroundTruth",
    "InstanceQueries",
    "Ints",
    "LidarMounting",
    "Mask",
    "Message",
    "ObjectClass",
    "Observation",
    "Odometry",
    "PointCloud",
    "PoseEstimate",
    "SensorView",
    "Sweep",
    "Tracks",
    "seconds_to_ns",
    "stack_xyz_yaw",
]
