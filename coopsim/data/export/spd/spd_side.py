"""One side of a V2X-Seq-SPD frame: its levelled LiDAR frame, calibrations and labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.data.export.export_frame import CameraShot, ExportAgent, ExportFrame, LidarScan
from coopsim.data.export.record_parts import token
from coopsim.data.export.seen_share import occlusion_levels
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.sensors.camera.crops import rectangles
from coopsim.types import Ints, Mask, ObjectClass

SPD_TYPES = {
    ObjectClass.CAR: "Car",
    ObjectClass.VAN: "Van",
    ObjectClass.TRUCK: "Truck",
    ObjectClass.BUS: "Bus",
    ObjectClass.MOTORCYCLE: "Motorcyclist",
    ObjectClass.BICYCLE: "Cyclist",
    ObjectClass.SCOOTER: "Motorcyclist",
    ObjectClass.PEDESTRIAN: "Pedestrian",
    ObjectClass.CHILD: "Pedestrian",
}
"""SPD's type of each class; it has no scooters and no children."""

_DIGITS = 6


@dataclass(frozen=True, slots=True, eq=False)
class SpdSide:
    """An agent in one frame, as a side of SPD.

    Points and labels are in a frame at the LiDAR that is level and looks along the LiDAR's heading: SPD's virtual LiDAR
    of a roadside unit, which is levelled, and the LiDAR of a car that stands upright.

    Attributes:
        name: "veh" or "inf".
        column: number of the agent in the frame.
        agent: the agent.
        scan: its LiDAR's points.
        shot: its camera's picture; None: none.
    """

    name: str
    column: int
    agent: ExportAgent
    scan: LidarScan
    shot: CameraShot | None

    @property
    def base_SE3_level(self) -> SE3:
        """The frame of points and labels."""
        mounting = self.scan.mounting.base_SE3_lidar
        return SE3.from_xyz_yaw(mounting.translation, mounting.yaw)

    @property
    def world_SE3_level(self) -> SE3:
        """The frame of points and labels, in the world."""
        return self.agent.world_SE3_base.compose(self.base_SE3_level)

    def points(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """Return the points (P, 3) m in the levelled frame."""
        level_SE3_lidar = self.base_SE3_level.inverse().compose(self.scan.mounting.base_SE3_lidar)
        return level_SE3_lidar.apply(self.scan.points).astype(np.float32)

    def camera_calibrations(self, lidar: str) -> dict[str, Mapping[str, Any]]:
        """Return the files about the camera by folder; `lidar` is "lidar" or "virtuallidar"."""
        if self.shot is None:
            return {}
        lens = self.shot.calibration
        camera_SE3_level = lens.base_SE3_camera.inverse().compose(self.base_SE3_level)
        intrinsic = {
            "cam_K": lens.matrix.ravel().tolist(),
            "cam_D": lens.distortion.tolist(),
            "height": lens.size[0],
            "width": lens.size[1],
        }
        return {"camera_intrinsic": intrinsic, f"{lidar}_to_camera": rigid(camera_SE3_level)}

    def labels(self, frame: ExportFrame, hit: Ints) -> list[dict[str, Any]]:
        """Return the label of each object of some rows (N,), those that this side's LiDARs hit."""
        in_base = frame.objects.boxes[hit].transform(self.agent.world_SE3_base.inverse())
        boxes = in_base.transform(self.base_SE3_level.inverse())
        if self.shot is None:
            px, size = np.full((len(hit), 4), np.nan), (0, 0)
        else:
            px, size = rectangles([self.shot.calibration], in_base)[0], self.shot.calibration.size
        low, high = px[:, :2] <= -0.5, px[:, 2:] >= [size[1] - 0.5, size[0] - 0.5]
        cut: Mask = np.any([low.any(axis=1), high.any(axis=1)], axis=0)
        alpha = wrap_angle(boxes.yaw - np.arctan2(boxes.center[:, 1], boxes.center[:, 0]))
        occluded = occlusion_levels(frame, self.column)[hit]
        return [
            {
                "token": token(self.name, frame.seed, frame.index, int(frame.objects.id[row])),
                "type": SPD_TYPES[ObjectClass(frame.objects.label[row])],
                "track_id": f"{int(frame.objects.id[row]):06d}",
                "truncated_state": int(cut[n]),
                "occluded_state": int(occluded[n]),
                "alpha": round(float(alpha[n]), _DIGITS),
                "2d_box": _rectangle(px[n]),
                **box_fields(boxes, n),
            }
            for n, row in enumerate(hit)
        ]


def box_fields(boxes: Boxes3D, row: int) -> dict[str, Any]:
    """Return the fields of a box: full sizes, the middle, and the turn about z."""
    length, width, height = boxes.size[row].tolist()
    x, y, z = boxes.center[row].round(_DIGITS).tolist()
    return {
        "3d_dimensions": {"h": height, "w": width, "l": length},
        "3d_location": {"x": x, "y": y, "z": z},
        "rotation": round(float(boxes.yaw[row]), _DIGITS),
    }


def rigid(transform: SE3) -> dict[str, Any]:
    """Return a transform as SPD writes it: rows of the rotation, and a column."""
    return {"rotation": transform.rotation.tolist(), "translation": transform.translation[:, None].tolist()}


def _rectangle(px: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    """Return a rectangle; zeros for an object that the picture does not show."""
    numbers = np.nan_to_num(px).round(2).tolist()
    return dict(zip(("xmin", "ymin", "xmax", "ymax"), numbers, strict=True))
