"""KITTI's tracking benchmark: one sequence per episode and agent; docs/reference/export.md has every field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coopsim.data.export.export_format import EXPORT_FORMATS, ExportFormat, LineFile, require_lidar
from coopsim.data.export.export_frame import ExportAgent, ExportFrame, ExportPlan, LidarScan
from coopsim.data.export.seen_share import occlusion_levels
from coopsim.data.files.pcd import encode_float_points
from coopsim.data.kitti import AXES_SE3_CAMERA
from coopsim.data.single_car.kitti_tracking_folder import EARTH_M
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.sensors.camera.projection import rectangles
from coopsim.support.checks import require_choice
from coopsim.support.files import make_folder, write_whole, write_whole_bytes
from coopsim.support.pictures import encode_png
from coopsim.types import NS_PER_S, AgentSpec, CameraCalibration, ObjectClass

_SIZE, _FOCAL_PX, _MIDDLE_PX = (375, 1242), 721.5377, (609.5593, 172.854)
_UPRIGHT = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LabelFrame:
    """Frame of an agent's labels: at its camera, which looks level along the camera's heading.

    KITTI's camera hardly nods. That of a mast does: its labels are in the frame of a level camera at the same place,
    and the projection matrix turns it down.

    Attributes:
        camera: the calibration of the pictures; without a camera, that of KITTI's, on the LiDAR.
        base_SE3_level: the frame with our axes (x forward, y left, z up), in the agent's base frame.
    """

    camera: CameraCalibration
    base_SE3_level: SE3

    @classmethod
    def of(cls, scan: LidarScan, camera: CameraCalibration | None) -> LabelFrame:
        """Return the frame of an agent's LiDAR and camera."""
        if camera is None:
            mounting = scan.mounting.base_SE3_lidar
            level = SE3.from_xyz_yaw(mounting.translation, mounting.yaw)
            matrix = np.array([[_FOCAL_PX, 0.0, _MIDDLE_PX[0]], [0.0, _FOCAL_PX, _MIDDLE_PX[1]], [0.0, 0.0, 1.0]])
            camera = CameraCalibration(_SIZE, matrix, np.zeros(5), level.compose(AXES_SE3_CAMERA))
        ahead = camera.base_SE3_camera.rotation[:, 2]
        yaw = float(np.arctan2(ahead[1], ahead[0])) if np.hypot(ahead[0], ahead[1]) > _UPRIGHT else 0.0
        return cls(camera, SE3.from_xyz_yaw(camera.base_SE3_camera.translation, yaw))

    @property
    def base_SE3_rect(self) -> SE3:
        """The frame with the axes of a camera: KITTI's rectified camera coordinates."""
        return self.base_SE3_level.compose(AXES_SE3_CAMERA)

    @property
    def projection(self) -> Floats:
        """(3, 4) matrix P2 from the rectified camera's coordinates to pixels."""
        camera_SE3_rect = self.camera.base_SE3_camera.inverse().compose(self.base_SE3_rect)
        matrix: Floats = self.camera.matrix @ np.column_stack([camera_SE3_rect.rotation, np.zeros(3)])
        return matrix


def calibration_text(frame: LabelFrame, scan: LidarScan) -> str:
    """Return the lines of a sequence's file in `calib`. All four projections are that of the one camera."""
    rect_SE3_lidar = frame.base_SE3_rect.inverse().compose(scan.mounting.base_SE3_lidar)
    lidar_SE3_base = scan.mounting.base_SE3_lidar.inverse()
    rows = {
        **{f"P{number}:": frame.projection for number in range(4)},
        "R_rect": np.eye(3),
        "Tr_velo_cam": _matrix(rect_SE3_lidar),
        "Tr_imu_velo": _matrix(lidar_SE3_base),
    }
    return "".join(f"{name} {' '.join(f'{value:.12e}' for value in row.ravel())}\n" for name, row in rows.items())


def front_camera(agent: ExportAgent, name: str | None) -> str | None:
    """Return the name of an agent's camera: the given one, else the one that looks most ahead; None without any."""
    if name is not None or not agent.cameras:
        return name
    return max(agent.cameras, key=lambda each: agent.cameras[each].calibration.base_SE3_camera.rotation[0, 2])


def _matrix(transform: SE3) -> Floats:
    return np.column_stack([transform.rotation, transform.translation])


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


GRAVITY = 9.81
"""m/s^2, which an accelerometer at rest feels upwards."""

OXTS_FIELDS = (
    *("lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu", "ax", "ay", "az", "af", "al", "au"),
    *("wx", "wy", "wz", "wf", "wl", "wu", "pos_accuracy", "vel_accuracy"),
    *("navstat", "numsats", "posmode", "velmode", "orimode"),
)
"""KITTI's 30 columns."""

_EXACT = 0.0
_MODES = (4, 0, 0, 0, 0)  # "locked"; there are no satellites


class OxtsLines:
    """The lines of one agent's sequence, whose accelerations and turn rates come from successive frames."""

    def __init__(self, column: int) -> None:
        self._column = column
        self._last: tuple[int, Floats, Floats, float] | None = None

    def line(self, frame: ExportFrame) -> str:
        """Return the line of the next frame. In the first one accelerations and turn rates are 0."""
        agent = frame.agents[self._column]
        pose = agent.world_SE3_base
        place, yaw = pose.translation, pose.yaw
        velocity, acceleration, rate = np.zeros(3), np.zeros(3), 0.0
        if self._last is not None:
            elapsed_s = (frame.time_ns - self._last[0]) / NS_PER_S
            velocity = (place - self._last[1]) / elapsed_s
            rate = float(wrap_angle(yaw - self._last[3])) / elapsed_s
        own = frame.objects.id == agent.body.actor_id
        if own.any():
            velocity[:2] = frame.velocity[own][0]
        if self._last is not None:
            acceleration = (velocity - self._last[2]) / elapsed_s
        self._last = frame.time_ns, place, velocity, yaw
        ahead, aside = (pose.rotation.T @ velocity)[:2]
        felt = pose.rotation.T @ acceleration
        numbers = [
            *_latitude_longitude(place), place[2], 0.0, 0.0, yaw,
            velocity[1], velocity[0], ahead, aside, velocity[2],
            felt[0], felt[1], felt[2] + GRAVITY, *felt,
            0.0, 0.0, rate, 0.0, 0.0, rate, _EXACT, _EXACT,
        ]  # fmt: skip
        return " ".join([f"{number:.12f}" for number in numbers] + [str(mode) for mode in _MODES])


def _latitude_longitude(place: Floats) -> tuple[float, float]:
    """Return degrees: the inverse of mx = R lon pi / 180, my = R ln(tan(pi (90 + lat) / 360))."""
    latitude = 2 * np.arctan(np.exp(place[1] / EARTH_M)) - np.pi / 2
    return float(np.degrees(latitude)), float(np.degrees(place[0] / EARTH_M))


LABELLED = ("around", "picture")


class _Sequence:
    """The growing files of one agent's sequence."""

    def __init__(self, root: Path, name: str, column: int) -> None:
        self.name, self.column, self.oxts = name, column, OxtsLines(column)
        for kind in ("oxts", "label_02", "calib"):
            make_folder(root / kind)
        make_folder(root / "velodyne" / name)
        self.oxts_file, self.label_file = (
            LineFile(root / "oxts" / f"{name}.txt"),
            LineFile(root / "label_02" / f"{name}.txt"),
        )

    def close(self) -> None:
        self.oxts_file.close()
        self.label_file.close()


@EXPORT_FORMATS.register("kitti")
class KittiFormat(ExportFormat):
    """KITTI tracking: velodyne, image_02, calib, oxts and label_02.

    Args:
        agent: name of the only agent to export; None: all, a sequence each.
        lidar: name of the LiDAR whose points are written; None: the first of each agent.
        camera: name of the camera of `image_02`; None: the one that looks most ahead.
        labels: "around" labels all objects that the agent's LiDARs hit; "picture" those of them that the camera shows,
            as KITTI does.
    """

    reader = "kitti"

    def __init__(
        self, agent: str | None = None, lidar: str | None = None, camera: str | None = None, labels: str = "around"
    ) -> None:
        require_choice("labels", labels, LABELLED)
        self._agent, self._lidar, self._camera, self._labels = agent, lidar, camera, labels

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        if self._agent is not None:
            require_choice("agent", self._agent, agents)
        self._kinds = {name: each.kind for name, each in agents.items() if self._agent in (None, name)}
        for name in self._kinds:
            require_lidar(name, agents[name], self._lidar)
            if self._camera is not None:
                require_choice("camera", self._camera, agents[name].cameras, f"of {name}")
            for camera, calibration in agents[name].cameras.items():
                if calibration.distortion.any():
                    raise InvalidValueError(
                        f"pictures must be without distortion in this format, {camera} of {name} has some"
                    )

    def begin(self, folder: Path, plan: ExportPlan) -> None:
        self._root, self._plan = folder / "training", plan

    def begin_episode(self, seed: int) -> None:
        self._seed = seed
        self._sequences: list[_Sequence] = []

    def write(self, frame: ExportFrame) -> None:
        if frame.index == 0:
            columns = [number for number, each in enumerate(frame.agents) if each.name in self._kinds]
            names = self._sequence_names()
            self._sequences = [
                _Sequence(self._root, names[self._seed, frame.agents[column].name], column) for column in columns
            ]
        for sequence in self._sequences:
            self._write_agent(frame, frame.agents[sequence.column], sequence)

    def end_episode(self) -> None:
        for sequence in self._sequences:
            sequence.close()

    def end(self) -> None:
        last = self._plan.frames
        names = self._sequence_names()
        write_whole(
            self._root / "evaluate_tracking.seqmap.training",
            "".join(f"{name} empty 000000 {last:06d}\n" for name in names.values()),
        )
        lines = [
            f"{name},{self._plan.episode_name(seed)},{agent},{self._kinds[agent]}\n"
            for (seed, agent), name in names.items()
        ]
        write_whole(self._root / "sequences.csv", "".join(["sequence,episode,agent,kind\n", *lines]))

    def _sequence_names(self) -> dict[tuple[int, str], str]:
        """Return the number of each sequence as four digits, by seed and agent."""
        pairs = [(seed, agent) for seed in self._plan.seeds for agent in self._kinds]
        return {pair: f"{number:04d}" for number, pair in enumerate(pairs)}

    def _write_agent(self, frame: ExportFrame, agent: ExportAgent, sequence: _Sequence) -> None:
        scan = agent.scan(self._lidar)
        camera = front_camera(agent, self._camera)
        shot = None if camera is None else agent.cameras[camera]
        labels = LabelFrame.of(scan, None if shot is None else shot.calibration)
        if frame.index == 0:
            write_whole(self._root / "calib" / f"{sequence.name}.txt", calibration_text(labels, scan))
        points = self._root / "velodyne" / sequence.name / f"{frame.index:06d}.bin"
        write_whole_bytes(points, encode_float_points(scan.points, scan.intensity))
        if shot is not None and shot.image.rgb is not None:
            folder = self._root / "image_02" / sequence.name
            make_folder(folder)
            write_whole_bytes(folder / f"{frame.index:06d}.png", encode_png(shot.image.rgb))
        sequence.oxts_file.append(sequence.oxts.line(frame))
        lines = label_lines(frame, sequence.column, labels, only_in_picture=self._labels == "picture")
        if not lines and frame.index == self._plan.frames - 1:
            lines = [NOTHING_LABELLED.format(frame=frame.index)]
        sequence.label_file.append(*lines)
