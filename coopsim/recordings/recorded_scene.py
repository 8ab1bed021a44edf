"""A frame of a recording as the simulator's own frames are: agents' bodies, actors, and their numbers of returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.geometry.se3 import Floats
from coopsim.recordings.recorded_folder import RecordedFrame, RecordedObjects, RecordedSequence
from coopsim.support.arrays import look_up
from coopsim.support.kernels import njit
from coopsim.types import NS_PER_S, Ints, Mask, Sweep
from coopsim.world.snapshot import Actors, AgentBody

MARGIN_M = 0.1
"""By which a point may be outside of a box on which it counts."""

_GREY = (128, 128, 128)


class RecordedScenes:
    """The frames of a sequence, every so many-th, as scenes."""

    def __init__(self, sequence: RecordedSequence, every: int = 1, first: int = 0) -> None:
        self._sequence, self._every, self._first = sequence, every, first
        self._read: dict[int, RecordedFrame] = {}

    def __len__(self) -> int:
        return -(-(self._sequence.frames - self._first) // self._every)

    def frame(self, number: int) -> RecordedFrame:
        """Return a frame; the last ones are kept.

        Raises:
            RecordingError: a file is missing or broken.
        """
        if number not in self._read:
            read = self._sequence.frame(self._first + number * self._every)
            self._read = {key: kept for key, kept in self._read.items() if abs(key - number) <= 1} | {number: read}
        return self._read[number]

    def actors(self, number: int) -> Actors:
        """Return the objects of a frame as actors. Their velocities are those since the frame before; of objects that
        were not there, until the next one; 0 of those that are in neither.
        """
        now = self.frame(number)
        velocity, known = np.zeros((len(now.objects), 2)), np.zeros(len(now.objects), np.bool_)
        for other in (number - 1, number + 1):
            if 0 <= other < len(self) and not known.all():
                _fill_velocities(velocity, known, now, self.frame(other))
        return as_actors(now.objects, velocity)

    def bodies(self, number: int) -> dict[str, AgentBody]:
        """Return the agents' bodies. A car's own object is the one of its id, or the one that covers its position."""
        frame = self.frame(number)
        return {
            name: AgentBody(
                name,
                self._sequence.agents[name].kind,
                _own_object(frame, name, self._sequence.agents[name].kind),
                agent.world_SE3_base,
                float(agent.base_SE3_lidar.translation[2]),
            )
            for name, agent in frame.agents.items()
        }


def as_actors(objects: RecordedObjects, velocity: Floats) -> Actors:
    """Return objects as actors with velocities (N, 2) m/s; pictures of the scene show them grey."""
    count = len(objects)
    colors = np.tile(np.array(_GREY, np.uint8), (count, 1))
    return Actors(objects.id, objects.boxes, velocity, objects.label, np.zeros(count, np.int64), colors)


def count_returns_in(boxes: Boxes3D, sweeps: Sequence[Sweep]) -> Ints:
    """Return the number of points (N,) in each of N boxes, of all sweeps; boxes and points are in one frame."""
    return count_points_in(boxes, [sweep.points for sweep in sweeps])


def count_points_in(boxes: Boxes3D, clouds: Sequence[NDArray[np.float32]]) -> Ints:
    """Return the number of points (N,) in each of N boxes, of all clouds (P, 3); boxes and points are in one frame.

    Points are on surfaces and err, and labels are tight: boxes are taken `MARGIN_M` larger, but not towards the ground.
    """
    counts, rows = np.zeros(len(boxes), np.int64), boxes.array
    rows[:, 3:6] += [2 * MARGIN_M, 2 * MARGIN_M, MARGIN_M]
    rows[:, 2] += MARGIN_M / 2
    for points in clouds:
        counts += _points_within(rows, points)
    return counts


def returns_of(actors: Actors, bodies: Mapping[str, AgentBody], sweeps: Mapping[str, Mapping[str, Sweep]]) -> Ints:
    """Return the number of points (N, A) that each of A agents has on each of N actors, but none on itself.

    Actors are in the world frame, sweeps (by agent and LiDAR) in the agents' base frames.
    """
    returns = np.zeros((len(actors), len(bodies)), np.int64)
    for column, (name, body) in enumerate(bodies.items()):
        boxes = actors.boxes.transform(body.world_SE3_base.inverse())
        returns[:, column] = count_returns_in(boxes, list(sweeps[name].values()))
        returns[actors.id == body.actor_id, column] = 0
    return returns


def _own_object(frame: RecordedFrame, name: str, kind: str) -> int | None:
    """Return the id of an agent's own object among those of a frame; None: it is not there."""
    agent, objects = frame.agents[name], frame.objects
    if agent.object_id is not None or kind != "cav":
        return agent.object_id if agent.object_id in objects.id else None
    over = objects.id[covers(objects.boxes, agent.world_SE3_base.translation[:2])]
    return int(over[0]) if len(over) else None


def _fill_velocities(velocity: Floats, known: Mask, now: RecordedFrame, other: RecordedFrame) -> None:
    """Set the velocities (N, 2) m/s that are not known (N,) of objects that are in another frame, too."""
    span_s = (now.time_ns - other.time_ns) / NS_PER_S
    order = np.argsort(other.objects.id)
    place, there = look_up(other.objects.id[order], now.objects.id)
    new = there & ~known
    if span_s and new.any():
        moved = now.objects.boxes.center[new, :2] - other.objects.boxes.center[order[place[new]], :2]
        velocity[new], known[new] = moved / span_s, True


@njit(cache=True, nogil=True)
def _points_within(boxes: Floats, points: NDArray[np.float32]) -> Ints:
    """Return the number of points (P, 3) in each of the boxes (N, 7)."""
    counts = np.zeros(len(boxes), np.int64)
    for n in range(len(boxes)):
        x, y, z, length, width, height, yaw = boxes[n]
        cos, sin = np.cos(yaw), np.sin(yaw)
        reach = (length + width) / 2
        for p in range(len(points)):
            dx, dy = points[p, 0] - x, points[p, 1] - y
            if abs(dx) > reach or abs(dy) > reach or abs(points[p, 2] - z) > height / 2:
                continue
            if abs(dx * cos + dy * sin) <= length / 2 and abs(dy * cos - dx * sin) <= width / 2:
                counts[n] += 1
    return counts
