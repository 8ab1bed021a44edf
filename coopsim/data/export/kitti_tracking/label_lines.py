"""Lines of KITTI's tracking labels."""

from __future__ import annotations

import numpy as np

from coopsim.data.export.export_frame import ExportFrame
from coopsim.data.export.kitti_tracking.label_frame import LabelFrame
from coopsim.data.export.seen_share import occlusion_levels
from coopsim.geometry.se3 import wrap_angle
from coopsim.sensors.camera.crops import rectangles
from coopsim.types import ObjectClass

KITTI_TYPES = {
    ObjectClass.CAR: "Car",
    ObjectClass.VAN: "Van",
    ObjectClass.TRUCK: "Truck",
    ObjectClass.BUS: "Truck",
    ObjectClass.MOTORCYCLE: "Misc",
    ObjectClass.BICYCLE: "Cyclist",
    ObjectClass.SCOOTER: "Misc",
    ObjectClass.PEDESTRIAN: "Pedestrian",
    ObjectClass.CHILD: "Pedestrian",
}
"""KITTI's type of each class. It has no buses, and counts powered two-wheelers as miscellaneous."""

NOTHING_LABELLED = "{frame} -1 DontCare -1 -1 -10.000000 -1 -1 -1 -1 -1 -1 -1 -1000 -1000 -1000 -10"
"""Line of a frame without objects: in a sequence's last frame it tells readers how long the sequence is."""

_IN_PICTURE, _CUT, _OUTSIDE = 0, 1, 2


def label_lines(frame: ExportFrame, column: int, labels: LabelFrame, *, only_in_picture: bool) -> list[str]:
    """Return a line for each object that an agent's LiDARs hit.

    Truncation is 0 in the picture, 1 cut by its edge, 2 outside, where the rectangle is -1 -1 -1 -1.

    Args:
        frame: to export.
        column: number of the agent.
        labels: frame of the labels.
        only_in_picture: leave out objects outside the picture.
    """
    hit = np.flatnonzero(frame.returns[:, column] > 0)
    in_base = frame.objects.boxes[hit].transform(frame.agents[column].world_SE3_base.inverse())
    boxes = in_base.transform(labels.base_SE3_level.inverse())
    left_to_bottom = rectangles([labels.camera], in_base)[0]
    rows, columns = labels.camera.size
    outside = np.isnan(left_to_bottom[:, 0])
    cut = (left_to_bottom[:, :2] <= -0.5).any(axis=1) | (left_to_bottom[:, 2:] >= [columns - 0.5, rows - 0.5]).any(
        axis=1
    )
    truncated = np.where(outside, _OUTSIDE, np.where(cut, _CUT, _IN_PICTURE))
    px = np.where(outside[:, None], -1.0, np.clip(left_to_bottom, 0.0, [columns - 1, rows - 1] * 2))
    x, y, z = -boxes.center[:, 1], -boxes.bottom, boxes.center[:, 0]
    turn = wrap_angle(-boxes.yaw - np.pi / 2)
    alpha = wrap_angle(turn - np.arctan2(x, z))
    numbers = np.column_stack([alpha, px, boxes.size[:, ::-1], x, y, z, turn])
    occluded = occlusion_levels(frame, column)[hit]
    return [
        f"{frame.index} {frame.objects.id[row]} {KITTI_TYPES[ObjectClass(frame.objects.label[row])]} "
        f"{truncated[n]} {occluded[n]} {' '.join(f'{value:.6f}' for value in numbers[n])}"
        for n, row in enumerate(hit)
        if not (only_in_picture and outside[n])
    ]
