"""Folders of OPV2V, and of V2XSet, which has the same files and roadside units with negative ids.

| field of a frame's YAML | read as |
|---|---|
| `lidar_pose` | x, y, z m, roll, yaw, pitch degrees of the LiDAR in CARLA's world |
| `true_ego_pos` | the same of the car, on the ground: the base frame |
| `vehicles.<id>` | what the agent's LiDAR hit: `location` + `center` (m, world axes), `extent` (half), `angle` |
| `camera<k>` | `cords` (pose in the world) or `extrinsic` (camera in the LiDAR's frame), and `intrinsic` |

Files that coopsim exported have a few fields more: `agent`, `time_ns`, `others` (objects that are no vehicles), and of
a camera `name` and `distortion`.

Angles are roll, yaw, pitch, degrees. Where `true_ego_pos` is missing or not under the LiDAR, the base frame lies
`lidar_height_m` under it. An object is a car unless it has an `obj_type`. The objects of a frame are the union of what
its agents list. The id of a car's folder is its own id among the objects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from coopsim.data.files.carla_axes import CAMERA_SE3_BODY, from_carla_pose, mirror, mirror_transform
from coopsim.data.files.pcd import read_pcd
from coopsim.data.recordings.file_fields import Fields, as_id, read_tagged_yaml
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, class_of, join_objects, sweep_in_base
from coopsim.data.recordings.stamped_folders import (
    HEIGHT_M,
    StampedFolder,
    StampedScenario,
    StampedSequence,
    has_tables_of_poses,
)
from coopsim.geometry.se3 import SE3
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    RecordedAgent,
    RecordedFrame,
    RecordedName,
    RecordedObjects,
    RecordedPicture,
    find_picture,
    name_agents,
)
from coopsim.types import NS_PER_S, Sweep, seconds_to_ns

EXTRA_NUMBER = 900_000
"""From this number on, agents of coopsim's exports are no cars: all roadside units but the first, and drones. So they
sort after the cars."""

_CAMERAS = tuple(f"camera{k}" for k in range(4))
_UNDER_M = (0.5, 300.0)  # a position of the agent is on the ground if the LiDAR is so far above it
_BESIDE_M = 5.0  # and so near


@RECORDINGS.register("opv2v")
@dataclass(frozen=True)
class Opv2vFolder(StampedFolder):
    """A folder of OPV2V: a scenario, a split, or all of it."""

    layout = "<scenario>/<agent id>/<time stamp>.yaml with .pcd (OPV2V, V2XSet, V2V4Real)"

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return has_tables_of_poses(path) is False

    @cached_property
    def frame_s(self) -> float:
        if self.options.frame_s is not None:
            return float(self.options.frame_s)
        scenario = next(iter(self.scenarios.values()))
        agent = next(name for names in scenario.agents for name in names)
        files = [read_tagged_yaml(scenario.file(agent, stamp, ".yaml")) for stamp in scenario.stamps[:2]]
        times_ns = [_time_ns(fields) for fields in files]
        if len(times_ns) < 2 or times_ns[0] is None or times_ns[1] is None:
            return self.usual_frame_s
        return (times_ns[1] - times_ns[0]) / NS_PER_S

    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        scenario = self.scenarios[sequence]
        cars, masts = scenario.agents
        drones = tuple(name for name in cars if int(name) >= EXTRA_NUMBER and _is_drone(scenario, name))
        more = tuple(name for name in cars if int(name) >= EXTRA_NUMBER and name not in drones)
        cars = tuple(name for name in cars if int(name) < EXTRA_NUMBER)
        return name_agents(cars, masts + more, drones)

    def _open(self, sequence: str) -> Opv2vSequence:
        scenario = self.scenario(sequence)
        return Opv2vSequence(sequence, self.agents(sequence), self.frame_s, scenario, self.options)


@dataclass(frozen=True)
class Opv2vSequence(StampedSequence):
    """A scenario of OPV2V."""

    def frame(self, number: int) -> RecordedFrame:
        stamp = self.scenario.stamps[number]
        files = {name: self._fields(agent.recorded, stamp) for name, agent in self.agents.items()}
        agents = {name: self._agent(self.agents[name], stamp, fields) for name, fields in files.items()}
        objects = join_objects([_objects(fields) for fields in files.values()])
        return RecordedFrame(self._time_ns(number, files), agents, objects)

    def _time_ns(self, number: int, files: Mapping[str, Fields]) -> int:
        times_ns = {name: _time_ns(fields) for name, fields in files.items()}
        first, *others = times_ns
        for name in others:
            if times_ns[name] != times_ns[first]:
                raise files[name].error("time_ns", f"must be that of {first}, {times_ns[first]}, got {times_ns[name]}")
        time_ns = times_ns[first]
        return seconds_to_ns(number * self.frame_s) if time_ns is None else time_ns - self._begun_ns

    @cached_property
    def _begun_ns(self) -> int:
        first = next(iter(self.agents.values()))
        return _time_ns(self._fields(first.recorded, self.scenario.stamps[0])) or 0

    def _fields(self, agent: str, stamp: str) -> Fields:
        return read_tagged_yaml(self.scenario.file(agent, stamp, ".yaml"))

    def _agent(self, name: RecordedName, stamp: str, fields: Fields) -> RecordedAgent:
        world_SE3_lidar = from_carla_pose(fields.numbers("lidar_pose", (6,)))
        world_SE3_base = self._base(name, fields, world_SE3_lidar)
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        cloud = self.scenario.file(name.recorded, stamp, ".pcd")
        return RecordedAgent(
            world_SE3_base,
            base_SE3_lidar,
            partial(_read_sweep, cloud, base_SE3_lidar),
            partial(self._pictures, name, stamp, fields, world_SE3_base, base_SE3_lidar),
            int(name.recorded) if name.kind == "cav" else None,
        )

    def _base(self, name: RecordedName, fields: Fields, world_SE3_lidar: SE3) -> SE3:
        if "true_ego_pos" in fields:
            car = from_carla_pose(fields.numbers("true_ego_pos", (6,)))
            x, y, above = world_SE3_lidar.translation - car.translation
            if np.hypot(x, y) <= _BESIDE_M and _UNDER_M[0] <= above <= _UNDER_M[1]:
                return SE3.from_xyz_yaw(car.translation, car.yaw)
        return base_under(world_SE3_lidar, self.options.height_m(name.kind, HEIGHT_M))

    def _pictures(
        self, name: RecordedName, stamp: str, fields: Fields, world_SE3_base: SE3, base_SE3_lidar: SE3
    ) -> dict[str, RecordedPicture]:
        pictures: dict[str, RecordedPicture] = {}
        for camera in _CAMERAS:
            path = self.scenario.file(name.recorded, stamp, f"_{camera}.png")
            if camera not in fields or not path.is_file():
                continue
            about = fields.section(camera)
            if "cords" in about:
                world_SE3_body = from_carla_pose(about.numbers("cords", (6,)))
                base_SE3_body = world_SE3_base.inverse().compose(world_SE3_body)
            else:
                base_SE3_body = base_SE3_lidar.compose(mirror_transform(about.transform("extrinsic")))
            lens = about.numbers("distortion", (5,)) if "distortion" in about else None
            pose = base_SE3_body.compose(CAMERA_SE3_BODY.inverse())
            called = about.text("name") if "name" in about else camera
            pictures[called] = find_picture(path, about.numbers("intrinsic", (3, 3)), pose, lens)
        return pictures


def _time_ns(fields: Fields) -> int | None:
    return as_id(fields.value("time_ns"), fields.file, "time_ns") if "time_ns" in fields else None


def _is_drone(scenario: StampedScenario, agent: str) -> bool:
    fields = read_tagged_yaml(scenario.file(agent, scenario.stamps[0], ".yaml"))
    return "agent" in fields and fields.text("agent").startswith("drone")


def _objects(fields: Fields) -> RecordedObjects:
    """Return what one agent lists."""
    rows = LabelledRows()
    sections = [fields.section("vehicles"), *([fields.section("others")] if "others" in fields else [])]
    for key, about in (each for section in sections for each in section.sections()):
        label = class_of(about, "obj_type", "Car")
        if label is None:
            continue
        middle = about.numbers("location", (3,)) + about.numbers("center", (3,))
        heading_rad = from_carla_pose(np.append(middle, about.numbers("angle", (3,)))).yaw
        rows.add(as_object_id(key, fields), mirror(middle), 2 * about.sizes("extent", (3,)), heading_rad, label)
    return rows.objects()


def as_object_id(key: object, fields: Fields) -> int:
    """Return the id of an object among `vehicles`, an integer >= 1."""
    number = as_id(key, fields.file, "vehicles")
    if number < 1:
        raise fields.error("vehicles", f"must have ids >= 1, got {number}")
    return number


def _read_sweep(path: Path, base_SE3_lidar: SE3) -> Sweep:
    cloud = read_pcd(path)
    return sweep_in_base(base_SE3_lidar, mirror(cloud.points), cloud.intensity)
