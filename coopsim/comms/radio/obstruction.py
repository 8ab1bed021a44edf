"""Obstruction between two antennas: none, vehicles or buildings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask
from coopsim.world.snapshot import Actors, AgentBody

LinkState = Literal["LOS", "NLOSv", "NLOS"]
"""As in 3GPP TR 37.885, 6.2.1: free, blocked by vehicles, blocked by buildings."""


@dataclass(frozen=True, slots=True)
class Obstruction:
    """Kind of obstruction between two antennas, and the number of them above the highest vehicle in the way (2 without
    any).
    """

    state: LinkState = "LOS"
    above: int = 2


@dataclass(frozen=True, slots=True, eq=False)
class RadioScene:
    """Antennas and obstacles at one moment, in the world frame.

    Attributes:
        antennas: (3,) m by agent.
        carriers: id of the actor that carries an agent, which does not obstruct its antenna; None for a roadside unit.
        vehicles: M boxes.
        vehicle_id: (M,) ids of the vehicles' actors.
        walls: (W, 2, 2) m, the two ends of each wall of the buildings, which are higher than any antenna.
    """

    antennas: Mapping[str, Floats]
    carriers: Mapping[str, int | None] = field(default_factory=dict)
    vehicles: Boxes3D = field(default_factory=Boxes3D.empty)
    vehicle_id: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    walls: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))

    @classmethod
    def of(cls, bodies: Mapping[str, AgentBody], actors: Actors, buildings: Sequence[Floats]) -> RadioScene:
        """Make the surroundings of agents with antennas on top, among actors and footprints (K, 2) m of buildings."""
        up = {name: np.array([0.0, 0.0, body.height_m]) for name, body in bodies.items()}
        walls = [np.stack([footprint, np.roll(footprint, -1, axis=0)], axis=1) for footprint in buildings]
        return cls(
            {name: body.world_SE3_base.apply(up[name]) for name, body in bodies.items()},
            {name: body.actor_id for name, body in bodies.items()},
            actors.boxes,
            actors.id,
            np.concatenate([np.zeros((0, 2, 2)), *walls]),
        )

    def between(self, sender: str, receiver: str) -> Obstruction:
        """Return the obstruction of the straight line between two agents' antennas; the same in both directions."""
        start, end = self.antennas[sender], self.antennas[receiver]
        if _crossed(start[:2], end[:2], self.walls).any():
            return Obstruction("NLOS", 0)
        carriers = [
            carrier for carrier in (self.carriers.get(sender), self.carriers.get(receiver)) if carrier is not None
        ]
        blocks = _cut(start, end, self.vehicles) & ~np.isin(self.vehicle_id, carriers)
        if not blocks.any():
            return Obstruction()
        top_m = float((self.vehicles.center[blocks, 2] + self.vehicles.size[blocks, 2] / 2).max())
        return Obstruction("NLOSv", int(start[2] > top_m) + int(end[2] > top_m))


def _crossed(start: Floats, end: Floats, walls: Floats) -> Mask:
    """Return the mask (W,) of walls (W, 2, 2) that a line between two points (2,) crosses.

    Two segments cross if each has its ends on different sides of the other.
    """
    along, wall = end - start, walls[:, 1] - walls[:, 0]
    sides = [along[0] * (walls[:, k, 1] - start[1]) - along[1] * (walls[:, k, 0] - start[0]) for k in (0, 1)]
    ends = [
        wall[:, 0] * (point[1] - walls[:, 0, 1]) - wall[:, 1] * (point[0] - walls[:, 0, 0]) for point in (start, end)
    ]
    crossed: Mask = (sides[0] * sides[1] < 0) & (ends[0] * ends[1] < 0)
    return crossed


def _cut(start: Floats, end: Floats, boxes: Boxes3D) -> Mask:
    """Return the mask (M,) of boxes that a line between two points (3,) cuts, seen from above.

    By slabs (Kay and Kajiya 1986). From above, because a vehicle below the line still obstructs the wave (the first
    Fresnel zone is a metre wide and more at these distances), and TR 37.885 has a case for it.
    """
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    local = []
    for point in (start, end):
        x, y = (point[:2] - boxes.center[:, :2]).T
        local.append(np.column_stack([x * cos + y * sin, y * cos - x * sin]))
    first, run = local[0], local[1] - local[0]
    half = boxes.size[:, :2] / 2
    run = np.where(np.abs(run) < 1e-12, 1e-12, run)  # a parallel line is far outside of the slab, or inside all the way
    low, high = (-half - first) / run, (half - first) / run
    enter = np.maximum(np.minimum(low, high).max(axis=1), 0.0)
    leave = np.minimum(np.maximum(low, high).min(axis=1), 1.0)
    cut: Mask = enter < leave
    return cut
