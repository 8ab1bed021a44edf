"""OPV2V's folders, which V2XSet shares and OpenCOOD reads; see docs/reference/export.md for every field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coopsim.data.export.export_format import EXPORT_FORMATS, ExportFormat, require_lidar
from coopsim.data.export.export_frame import CameraShot, ExportAgent, ExportFrame, ExportPlan, LidarScan
from coopsim.data.files.carla_axes import CAMERA_SE3_BODY, mirror, mirror_transform, to_carla_pose
from coopsim.data.files.pcd import encode_rgb_pcd
from coopsim.data.recordings.opv2v_folder import EXTRA_NUMBER
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.lidar.returns import count_instances
from coopsim.support.files import make_folder, write_whole, write_whole_bytes
from coopsim.support.pictures import encode_png
from coopsim.types import CLASS_NAMES, AgentSpec, ObjectClass
from coopsim.types.taxonomy import Superclass

OBJECT_NUMBER = 100_000
"""Added to an object's id, so that all numbers have six digits: readers sort the folders of agents as texts."""

TICKS_PER_FRAME = 2
"""By which the names of frames count, as in OPV2V."""

KMH_PER_M_S = 3.6

_VEHICLES = [int(cls) for cls in ObjectClass if cls.superclass is not Superclass.PEDESTRIAN]


@EXPORT_FORMATS.register("opv2v", alias="v2xset")
class Opv2vFormat(ExportFormat):
    """OPV2V: an agent's points as PCD, poses and boxes as YAML, pictures as PNG.

    Args:
        lidar: name of the LiDAR whose points are written; None: the first of each agent.
    """

    reader = "opv2v"

    def __init__(self, lidar: str | None = None) -> None:
        self._lidar = lidar

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        for name, spec in agents.items():
            require_lidar(name, spec, self._lidar)

    def begin(self, folder: Path, plan: ExportPlan) -> None:
        self._folder, self._plan = folder, plan

    def begin_episode(self, seed: int) -> None:
        self._episode = self._folder / self._plan.episode_name(seed)

    def write(self, frame: ExportFrame) -> None:
        numbers, objects = agent_numbers(frame.agents), _object_lines(frame)
        is_vehicle = np.isin(frame.objects.label, _VEHICLES)
        for agent in frame.agents:
            folder = self._episode / str(numbers[agent.name])
            make_folder(folder)
            stem = f"{frame.index * TICKS_PER_FRAME:06d}"
            scan = agent.scan(self._lidar)
            cameras = _in_order(agent.cameras)
            write_whole_bytes(folder / f"{stem}.pcd", encode_rgb_pcd(mirror(scan.points), scan.intensity))
            for number, (_, shot) in enumerate(cameras):
                if shot.image.rgb is not None:
                    write_whole_bytes(folder / f"{stem}_camera{number}.png", encode_png(shot.image.rgb))
            seen = count_instances(scan.instance, frame.objects.id) > 0
            lines = _agent_lines(frame, agent, scan, cameras)
            lines += _listed("vehicles", objects, seen & is_vehicle) + _listed("others", objects, seen & ~is_vehicle)
            write_whole(folder / f"{stem}.yaml", "\n".join(lines) + "\n")


def agent_numbers(agents: Sequence[ExportAgent]) -> dict[str, int]:
    """Return the number of every agent by name, which is the name of its folder.

    A car's is that of its box. The first roadside unit is -1, by which readers know it; they take a second negative
    number for a car that all others serve, so further units, and drones, have numbers beyond all cars.
    """
    numbers: dict[str, int] = {}
    for position, agent in enumerate(agents):
        if agent.body.actor_id is not None:
            numbers[agent.name] = OBJECT_NUMBER + agent.body.actor_id
        elif agent.spec.kind == "rsu" and -1 not in numbers.values():
            numbers[agent.name] = -1
        else:
            numbers[agent.name] = EXTRA_NUMBER + position
    return numbers


def _in_order(cameras: Mapping[str, CameraShot]) -> list[tuple[str, CameraShot]]:
    """Return the cameras in OPV2V's order: from the front to the rear, of each pair the right one first."""

    def angle(shot: CameraShot) -> tuple[float, bool]:
        yaw = shot.calibration.base_SE3_camera.compose(CAMERA_SE3_BODY).yaw
        return round(abs(yaw), 6), yaw > 0

    return sorted(cameras.items(), key=lambda item: angle(item[1]))


def _agent_lines(
    frame: ExportFrame, agent: ExportAgent, scan: LidarScan, cameras: list[tuple[str, CameraShot]]
) -> list[str]:
    """Return the YAML of an agent itself. YAML's own writer would take longer than the simulation."""
    world_SE3_lidar = agent.world_SE3_base.compose(scan.mounting.base_SE3_lidar)
    lines = [
        f"agent: {agent.name}",
        f"time_ns: {frame.time_ns}",
        f"ego_speed: {_number(agent.speed_m_s * KMH_PER_M_S)}",
        f"lidar_pose: {_numbers(to_carla_pose(world_SE3_lidar))}",
        f"true_ego_pos: {_numbers(to_carla_pose(agent.world_SE3_base))}",
        f"predicted_ego_pos: {_numbers(to_carla_pose(agent.pose.world_SE3_base))}",
        "plan_trajectory: []",
    ]
    for number, (name, shot) in enumerate(cameras):
        lines += [f"camera{number}:", *_camera(name, shot, agent.world_SE3_base, world_SE3_lidar)]
    return lines


def _camera(name: str, shot: CameraShot, world_SE3_base: SE3, world_SE3_lidar: SE3) -> list[str]:
    calibration = shot.calibration
    world_SE3_body = world_SE3_base.compose(calibration.base_SE3_camera).compose(CAMERA_SE3_BODY)
    lidar_SE3_body = mirror_transform(world_SE3_lidar.inverse().compose(world_SE3_body))
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = lidar_SE3_body.rotation, lidar_SE3_body.translation
    lines = [
        f"  name: {name}",
        f"  cords: {_numbers(to_carla_pose(world_SE3_body))}",
        f"  intrinsic: {_rows(calibration.matrix)}",
        f"  extrinsic: {_rows(extrinsic)}",
    ]
    if calibration.distortion.any():
        lines.append(f"  distortion: {_numbers(calibration.distortion)}")
    return lines


def _object_lines(frame: ExportFrame) -> list[str]:
    """Return the line of every object of a frame, made once for all agents."""
    objects, lines = frame.objects, []
    speed = np.linalg.norm(frame.velocity, axis=1) * KMH_PER_M_S
    for row in range(len(objects)):
        x, y, _ = objects.boxes.center[row].tolist()
        half = objects.boxes.size[row] / 2
        fields = {
            "angle": _numbers([0.0, -np.degrees(objects.boxes.yaw[row]), 0.0]),
            "center": _numbers([0.0, 0.0, half[2]]),
            "extent": _numbers(half),
            "location": _numbers([x, -y, objects.boxes.bottom[row]]),
            "obj_type": CLASS_NAMES[objects.label[row]],
            "speed": _number(speed[row]),
        }
        content = ", ".join(f"{name}: {value}" for name, value in fields.items())
        lines.append(f"  {OBJECT_NUMBER + int(objects.id[row])}: {{{content}}}")
    return lines


def _listed(key: str, lines: Sequence[str], chosen: NDArray[np.bool_]) -> list[str]:
    """Return the chosen objects (N,) under a key."""
    found = [lines[row] for row in np.flatnonzero(chosen).tolist()]
    return [f"{key}:", *found] if found else [f"{key}: {{}}"]


def _rows(matrix: Floats) -> str:
    return f"[{', '.join(_numbers(row) for row in matrix)}]"


def _numbers(values: Sequence[float] | Floats) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _number(value: float) -> str:
    # Micrometres; never with an exponent, which YAML 1.1 takes for a text, and never as -0.
    return f"{round(float(value), 6) + 0.0:.6f}"
