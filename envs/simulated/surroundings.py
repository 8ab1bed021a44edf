"""The true surroundings of all agents in one frame, as rows: one agent's objects after another's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.detection.oracle import Oracles
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, SE3Batch, wrap_angle
from coopsim.support.kernels import njit
from coopsim.types import GroundTruth, Ints, Mask
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """The true surroundings of A agents.

    Attributes:
        oracles: the objects around each agent, K rows: all actors but the agent itself, in its base frame.
        returns: (K, A) number of LiDAR returns that each of the agents has from the row's object.
        visible_to: (K,): 0 the row's agent has returns, 1 only others have, 2 no agent has.
    """

    oracles: Oracles
    returns: Ints
    visible_to: Ints

    @classmethod
    def of(cls, bodies: Mapping[str, AgentBody], actors: Actors, returns: Ints) -> Self:
        """Return the surroundings of agents among N actors.

        Args:
            bodies: the A agents, by name.
            actors: all, in the world frame.
            returns: (N, A) number of LiDAR returns that each agent has from each actor.
        """
        world_SE3_base = tuple(body.world_SE3_base for body in bodies.values())
        base_SE3_world = SE3Batch.of([pose.inverse() for pose in world_SE3_base])
        turn, shift = base_SE3_world.rotation, base_SE3_world.translation
        own_id = np.array([0 if body.actor_id is None else body.actor_id for body in bodies.values()])
        start, row, center, velocity = _move(actors.id, actors.boxes.center, actors.velocity, own_id, turn, shift)
        own, from_row, visible_to = _count(start, row, returns)
        yaw = wrap_angle(actors.boxes.yaw[row] + np.repeat(base_SE3_world.yaw, np.diff(start)))
        around = actors.moved(row, Boxes3D.trusted(center, actors.boxes.size[row], yaw), velocity)
        return cls(Oracles(tuple(bodies), start, around, own, world_SE3_base, base_SE3_world), from_row, visible_to)

    def truths(self, region_m: tuple[float, float], *, all_count: bool) -> dict[str, GroundTruth]:
        """Return the ground truth by agent.

        Args:
            region_m: half the length and width of the evaluation region.
            all_count: all objects in the region count, not only those that some agent has a return from.
        """
        around, boxes = self.oracles.actors, self.oracles.actors.boxes
        in_region: Mask = np.all(np.abs(boxes.center[:, :2]) <= region_m, axis=1)
        counts = in_region if all_count else in_region & (self.visible_to < 2)
        truths, start = {}, self.oracles.start.tolist()
        for agent, begin, end in zip(self.oracles.agents, start, start[1:], strict=False):
            rows = slice(begin, end)
            truths[agent] = GroundTruth.trusted(
                around.id[rows],
                boxes[rows],
                around.label[rows],
                self.visible_to[rows],
                around.velocity[rows],
                self.returns[rows],
                in_region[rows],
                counts[rows],
            )
        return truths


@njit(cache=True, nogil=True)
def _move(
    ids: Ints, center: Floats, velocity: Floats, own_id: Ints, turn: Floats, shift: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Move N actors into the base frame of each of A agents but those that are the agent itself.

    Args:
        ids: (N,) of the actors.
        center: (N, 3) of their boxes.
        velocity: (N, 2).
        own_id: (A,) of the agents; 0 for agents that are no actors.
        turn: (A, 3, 3) rotation of each `base_SE3_world`.
        shift: (A, 3) translation of it.

    Returns:
        Where each agent's rows begin (A + 1,), the actor of each row (K,), and its center (K, 3) and velocity (K, 2).
    """
    most = len(ids) * len(own_id)
    start, row = np.zeros(len(own_id) + 1, np.int64), np.empty(most, np.int64)
    moved, driven, count = np.empty((most, 3)), np.empty((most, 2)), 0
    for a in range(len(own_id)):
        for n in range(len(ids)):
            if ids[n] == own_id[a]:
                continue
            x, y, z = center[n, 0], center[n, 1], center[n, 2]
            for axis in range(3):
                along = x * turn[a, axis, 0] + y * turn[a, axis, 1] + z * turn[a, axis, 2]
                moved[count, axis] = along + shift[a, axis]
            for axis in range(2):
                # From 0.0, as sums begin, lest a standing actor have the velocity -0.0.
                driven[count, axis] = 0.0 + velocity[n, 0] * turn[a, axis, 0] + velocity[n, 1] * turn[a, axis, 1]
            row[count] = n
            count += 1
        start[a + 1] = count
    return start, row[:count], moved[:count], driven[:count]


@njit(cache=True, nogil=True)
def _count(start: Ints, row: Ints, returns: Ints) -> tuple[Ints, Ints, Ints]:
    """Look up the returns (N, A) of the actor of each row (K,), for the rows of A agents.

    Returns:
        Those of the row's agent (K,), of all agents (K, A), and `Surroundings.visible_to` (K,).
    """
    agents = len(start) - 1
    own, everybody = np.empty(len(row), np.int64), np.empty((len(row), agents), np.int64)
    seen, visible_to = np.zeros(len(returns), np.bool_), np.empty(len(row), np.int64)
    for n in range(len(returns)):
        for a in range(agents):
            seen[n] |= returns[n, a] > 0
    for a in range(agents):
        for k in range(start[a], start[a + 1]):
            everybody[k] = returns[row[k]]
            own[k] = returns[row[k], a]
            visible_to[k] = 0 if own[k] > 0 else 1 if seen[row[k]] else 2
    return own, everybody, visible_to
