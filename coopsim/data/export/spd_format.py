"""V2X-Seq-SPD: a vehicle's side, a roadside unit's side, and labels of both; see docs/reference/export.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from coopsim.data.export.export_format import EXPORT_FORMATS, ExportFormat
from coopsim.data.export.export_frame import CameraShot, ExportAgent, ExportFrame, ExportPlan, LidarScan
from coopsim.data.export.kitti_format import front_camera
from coopsim.data.export.record_parts import FIRST_US, RecordParts, as_line, token
from coopsim.data.export.seen_share import occlusion_levels
from coopsim.data.files.pcd import encode_intensity_pcd
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.sensors.camera.projection import rectangles
from coopsim.support.checks import require_choice
from coopsim.support.files import make_folder, write_whole, write_whole_bytes
from coopsim.support.pictures import encode_jpeg
from coopsim.types import AgentSpec, Ints, Mask, ObjectClass

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


_FOLDERS = {"veh": "vehicle-side", "inf": "infrastructure-side"}
_LIDARS = {"veh": "lidar", "inf": "virtuallidar"}
_NO_LABEL = "-1"
_BRIGHTEST = 255.0


@EXPORT_FORMATS.register("v2x-seq", alias="spd")
class SpdFormat(ExportFormat):
    """V2X-Seq-SPD: vehicle-side, infrastructure-side and cooperative.

    Args:
        vehicle: name of the car; None: the first connected car.
        unit: name of the roadside unit; None: the first.
        lidar: name of the LiDAR whose points are written; None: the first of each agent.
        camera: name of the camera whose pictures are written; None: the one that looks most ahead.
    """

    reader = "spd"

    usual_options: ClassVar[Mapping[str, Any]] = {"cameras": "front"}

    def __init__(
        self, vehicle: str | None = None, unit: str | None = None, lidar: str | None = None, camera: str | None = None
    ) -> None:
        self._wanted = {"veh": vehicle, "inf": unit}
        self._lidar, self._camera = lidar, camera

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        kinds = {"veh": ("vehicle", "cav", "connected car"), "inf": ("unit", "rsu", "roadside unit")}
        self._names: dict[str, str] = {}
        for side, (parameter, kind, title) in kinds.items():
            fitting = [name for name, each in agents.items() if each.kind == kind]
            if not fitting:
                raise InvalidValueError(f"this format needs a {title}, agents are {', '.join(agents)}")
            name = self._wanted[side] or fitting[0]
            require_choice(parameter, name, fitting)
            self._names[side] = name
            if not agents[name].lidars:
                raise InvalidValueError(f"both sides need a LiDAR in this format, {name} has none")
            if self._lidar is not None:
                require_choice("lidar", self._lidar, agents[name].lidars, f"of {name}")
            if self._camera is not None:
                require_choice("camera", self._camera, agents[name].cameras, f"of {name}")

    def begin(self, folder: Path, plan: ExportPlan) -> None:
        self._root, self._plan = folder, plan
        self._lists = RecordParts(folder, [f"{side}/data_info" for side in (*_FOLDERS.values(), "cooperative")])

    def begin_episode(self, seed: int) -> None:
        self._sequence = self._plan.seeds.index(seed)
        self._lists.begin_episode(self._plan.episode_name(seed))

    def write(self, frame: ExportFrame) -> None:
        sides = {side: self._side(side, frame) for side in _FOLDERS}
        number = f"{self._sequence * self._plan.frames + frame.index:06d}"
        labels = {side: self._write_side(each, frame, number) for side, each in sides.items()}
        self._write(f"cooperative/label/{number}.json", _cooperative(frame, sides["veh"], labels, number))
        sequence = f"{self._sequence:04d}"
        pair = {"vehicle_frame": number, "infrastructure_frame": number}
        pair |= {"vehicle_sequence": sequence, "infrastructure_sequence": sequence}
        self._lists.append("cooperative/data_info", [{**pair, "system_error_offset": {"delta_x": 0.0, "delta_y": 0.0}}])

    def end_episode(self) -> None:
        self._lists.end_episode()

    def end(self) -> None:
        self._lists.join([self._plan.episode_name(seed) for seed in self._plan.seeds])

    def _side(self, side: str, frame: ExportFrame) -> SpdSide:
        column = next(n for n, agent in enumerate(frame.agents) if agent.name == self._names[side])
        agent: ExportAgent = frame.agents[column]
        camera = front_camera(agent, self._camera)
        scan = agent.scan(self._lidar)
        return SpdSide(side, column, agent, scan, None if camera is None else agent.cameras[camera])

    def _write_side(self, side: SpdSide, frame: ExportFrame, number: str) -> dict[int, dict[str, Any]]:
        """Write the files of one side. Return its labels by row of the objects."""
        root, lidar = _FOLDERS[side.name], _LIDARS[side.name]
        points = encode_intensity_pcd(side.points(), side.scan.intensity * np.float32(_BRIGHTEST))
        self._write_bytes(f"{root}/velodyne/{number}.pcd", points)
        if side.shot is not None and side.shot.image.rgb is not None:
            self._write_bytes(f"{root}/image/{number}.jpg", encode_jpeg(side.shot.image.rgb))
        files: dict[str, Any] = {f"calib/{name}": content for name, content in _calibrations(side).items()}
        hit = np.flatnonzero(frame.returns[:, side.column] > 0)
        labels = side.labels(frame, hit)
        files[f"label/{lidar}"] = labels
        files["label/camera"] = [label for label in labels if label["2d_box"]["xmax"] > 0]
        for name, each in files.items():
            self._write(f"{root}/{name}/{number}.json", each)
        self._lists.append(f"{root}/data_info", [self._information(side, frame, number, list(files))])
        return dict(zip(hit.tolist(), labels, strict=True))

    def _information(self, side: SpdSide, frame: ExportFrame, number: str, folders: list[str]) -> dict[str, Any]:
        first = self._sequence * self._plan.frames
        stamp, pictured = _stamp(frame), side.shot is not None
        names = {f"label/{_LIDARS[side.name]}": "label_lidar_std_path", "label/camera": "label_camera_std_path"}
        names |= {each: f"{each.replace('/', '_')}_path" for each in folders if each.startswith("calib/")}
        return {
            "image_path": f"image/{number}.jpg" if pictured else "",
            "pointcloud_path": f"velodyne/{number}.pcd",
            **{names[folder]: f"{folder}/{number}.json" for folder in folders},
            "intersection_loc": self._plan.name,
            "image_timestamp": stamp,
            "pointcloud_timestamp": stamp,
            "frame_id": number,
            "start_frame_id": f"{first:06d}",
            "end_frame_id": f"{first + self._plan.frames - 1:06d}",
            "num_frames": self._plan.frames,
            "sequence_id": f"{self._sequence:04d}",
        }

    def _write(self, path: str, content: Any) -> None:
        text = as_line(content) if isinstance(content, dict) else f"[{','.join(map(as_line, content))}]"
        make_folder((self._root / path).parent)
        write_whole(self._root / path, f"{text}\n")

    def _write_bytes(self, path: str, content: bytes) -> None:
        make_folder((self._root / path).parent)
        write_whole_bytes(self._root / path, content)


def _calibrations(side: SpdSide) -> dict[str, Mapping[str, Any]]:
    """Return the contents of a side's calibration files, by folder."""
    if side.name == "inf":
        placed = {**rigid(side.world_SE3_level), "relative_error": {"delta_x": 0.0, "delta_y": 0.0}}
        return {**side.camera_calibrations("virtuallidar"), "virtuallidar_to_world": placed}
    return {
        **side.camera_calibrations("lidar"),
        "lidar_to_novatel": {"transform": rigid(side.base_SE3_level)},
        "novatel_to_world": rigid(side.agent.world_SE3_base),
    }


def _cooperative(
    frame: ExportFrame, vehicle: SpdSide, labels: Mapping[str, Mapping[int, Mapping[str, Any]]], number: str
) -> list[dict[str, Any]]:
    """Return the labels of what either side hit, without the vehicle itself, in the vehicle's levelled frame."""
    own = vehicle.agent.body.actor_id
    rows = sorted(row for row in labels["veh"].keys() | labels["inf"].keys() if frame.objects.id[row] != own)
    boxes = frame.objects.boxes[np.array(rows, np.int64)].transform(vehicle.world_SE3_level.inverse())
    found = []
    for n, row in enumerate(rows):
        sides = {side: each[row] for side, each in labels.items() if row in each}
        label = next(iter(sides.values()))
        found.append(
            {
                "token": token("coop", frame.seed, frame.index, int(frame.objects.id[row])),
                **{key: label[key] for key in ("type", "track_id", "truncated_state", "occluded_state")},
                "2d_box": label["2d_box"] if "veh" in sides else dict.fromkeys(label["2d_box"], 0.0),
                **box_fields(boxes, n),
                "from_side": "coop" if len(sides) > 1 else next(iter(sides)),
                **{f"{side}_pointcloud_timestamp": _stamp(frame) for side in _FOLDERS},
                **{f"{side}_frame_id": number for side in _FOLDERS},
                **{f"{side}_{key}": sides.get(side, {}).get(key, _NO_LABEL) for side in _FOLDERS for key in _LINKS},
            }
        )
    return found


_LINKS = ("track_id", "token")


def _stamp(frame: ExportFrame) -> str:
    return str(FIRST_US + frame.time_ns // 1000)
