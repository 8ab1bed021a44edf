"""Folders of V2V4Real: OPV2V's layout with two cars, and poses and boxes of another kind.

| field of a frame's YAML | read as |
|---|---|
| `lidar_pose` | 4 x 4, pose of the LiDAR in the world (an array of NumPy, see `tagged_yaml`) |
| `vehicles.<id>` | in the LiDAR's own frame: `location` + `center`, `extent` (half), `angle` (roll, yaw, pitch) |
| `vehicles.<id>.obj_type`, `.ass_id` | the class, and the identity for both cars |

Axes are right-handed, as ours. An object without `ass_id`, or with -1, is known to one car only: its identity is its id
and 100 for each car before, as the data set's own code has it. All ids are one larger than there, so that none is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from coopsim.data.files.pcd import read_pcd
from coopsim.data.recordings.file_fields import Fields, as_id, read_tagged_yaml
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, class_of, join_objects, sweep_in_base
from coopsim.data.recordings.stamped_folders import HEIGHT_M, StampedFolder, StampedSequence, has_tables_of_poses
from coopsim.geometry.se3 import SE3
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    RecordedAgent,
    RecordedFrame,
    RecordedName,
    RecordedObjects,
    name_agents,
)
from coopsim.types import Sweep, seconds_to_ns

_OF_ONE_CAR = 100  # ids that each car has for itself
_NOBODY = -1


@RECORDINGS.register("v2v4real")
@dataclass(frozen=True)
class V2v4realFolder(StampedFolder):
    """A folder of V2V4Real: a scenario, a split, or all of it."""

    layout = "<scenario>/<agent id>/<time stamp>.yaml with .pcd (OPV2V, V2XSet, V2V4Real)"

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return has_tables_of_poses(path) is True

    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        return name_agents(*self.scenarios[sequence].agents)

    def _open(self, sequence: str) -> V2v4realSequence:
        scenario = self.scenario(sequence)
        return V2v4realSequence(sequence, self.agents(sequence), self.frame_s, scenario, self.options)


@dataclass(frozen=True)
class V2v4realSequence(StampedSequence):
    """A scenario of V2V4Real."""

    def frame(self, number: int) -> RecordedFrame:
        stamp = self.scenario.stamps[number]
        agents: dict[str, RecordedAgent] = {}
        listed: list[RecordedObjects] = []
        for place, (name, agent) in enumerate(self.agents.items()):
            fields = read_tagged_yaml(self.scenario.file(agent.recorded, stamp, ".yaml"))
            agents[name], objects = self._agent(agent, place, stamp, fields)
            listed.append(objects)
        return RecordedFrame(seconds_to_ns(number * self.frame_s), agents, join_objects(listed))

    def _agent(
        self, name: RecordedName, place: int, stamp: str, fields: Fields
    ) -> tuple[RecordedAgent, RecordedObjects]:
        world_SE3_lidar = fields.transform("lidar_pose")
        world_SE3_base = base_under(world_SE3_lidar, self.options.height_m(name.kind, HEIGHT_M))
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        cloud = self.scenario.file(name.recorded, stamp, ".pcd")
        agent = RecordedAgent(world_SE3_base, base_SE3_lidar, partial(_read_sweep, cloud, base_SE3_lidar))
        return agent, _rows(fields, place).objects(world_SE3_lidar)


def _rows(fields: Fields, place: int) -> LabelledRows:
    """Return what one car lists, in its LiDAR's frame; `place` is the car's among all."""
    rows = LabelledRows()
    for key, about in fields.section("vehicles").sections():
        label = class_of(about, "obj_type", "Car")
        if label is None:
            continue
        identity = as_id(about.value("ass_id"), fields.file, f"vehicles.{key}.ass_id") if "ass_id" in about else _NOBODY
        if identity == _NOBODY:
            identity = as_id(key, fields.file, "vehicles") + _OF_ONE_CAR * place
        if identity < 0:
            raise fields.error("vehicles", f"must have ids >= 0, got {identity}")
        middle = about.numbers("location", (3,)) + about.numbers("center", (3,))
        yaw_rad = float(np.radians(about.numbers("angle", (3,))[1]))
        rows.add(identity + 1, middle, 2 * about.sizes("extent", (3,)), yaw_rad, label)
    return rows


def _read_sweep(path: Path, base_SE3_lidar: SE3) -> Sweep:
    """Read a cloud whose intensities are a colour's red, in [0, 1], or a field, up to 255."""
    cloud = read_pcd(path)
    bright = cloud.intensity
    full_scale = 255.0 if bright is not None and bright.max(initial=0.0) > 1.0 else 1.0
    return sweep_in_base(base_SE3_lidar, cloud.points, bright, full_scale)
