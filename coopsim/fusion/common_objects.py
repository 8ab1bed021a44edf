"""Objects that several agents see, found despite errors of the agents' poses.

A pose error moves and turns all of an agent's boxes together. So the error that brings most of them onto others' boxes
is searched first (a vote over all pairs of boxes and a few headings), and pairs are matched under it. Matching each box
with its nearest would be enough only while errors are small against the distances between objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

ANYTHING = -1
"""The label of an object of unknown class: an agent does not state its own class."""

_REACH_M = 1.0
"""Boxes farther apart than this do not vote for an error that would bring them together. Detections of one object are
some decimetres apart, neighbouring objects more than a metre."""

_VOTE = 2.0
"""Log likelihood of a pair that lies together, against one that does not: two pairs outweigh an error of 2.8 sigma."""

_SIGMAS = 3.0
_HEADINGS = 7
_MOST_PAIRS = 64


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBoxes:
    """The boxes that one agent saw at one moment, placed by its stated pose.

    Attributes:
        origin: (2,) m, the agent's stated position; an error of its heading turns everything around it.
        position: (N, 2) m, centres of boxes, in the same frame.
        label: (N,) an `ObjectClass`, or `ANYTHING`.
    """

    origin: Floats
    position: Floats
    label: Ints

    def __len__(self) -> int:
        return len(self.label)

    def corrected(self, correction: Floats) -> Floats:
        """Return the positions (N, 2) under a correction (3,) of the agent's pose: x, y m and heading rad."""
        return self.origin + correction[:2] + turned(self.position - self.origin, correction[2])


@dataclass(frozen=True, slots=True, eq=False)
class CommonObjects:
    """N boxes that lie on K objects, each of which at least two agents saw; in order of the objects.

    Attributes:
        agent: (N,) number of the agent.
        row: (N,) row of the box among the agent's.
        object: (N,) number of the object in 0..K - 1, not falling; an agent has at most one box on an object.
    """

    agent: Ints
    row: Ints
    object: Ints

    def of_agent(self, agent: int) -> int:
        """Return the number of objects that an agent saw."""
        return int(np.count_nonzero(self.agent == agent))


def turned(vectors: Floats, angle_rad: float | Floats) -> Floats:
    """Turn vectors (N, 2) by an angle, or by each of H angles: (H, N, 2)."""
    cos, sin = np.cos(angle_rad)[..., None], np.sin(angle_rad)[..., None]
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)


def consensus(known: Floats, label: Ints, placed: PlacedBoxes, mean: Floats, sigma: Floats) -> Floats:
    """Find the correction of an agent's pose under which its boxes lie on known ones, roughly.

    Of all corrections that bring a pair of boxes together, with a heading from a coarse grid, the correction with the
    largest sum of votes and log prior wins. `mean` is a candidate too: without support it stays.

    Args:
        known: (N, 2) m, positions of objects.
        label: (N,) their classes.
        placed: the agent's boxes.
        mean: (3,) the expected correction: x, y m and heading rad.
        sigma: (3,) its standard deviations.

    Returns:
        (3,) the correction. Its error is that of a detection and of half a step of heading; see `pose_graph`.
    """
    gap, offset = _candidates(known, label, placed, mean, sigma)
    steps = np.linspace(-_SIGMAS, _SIGMAS, _HEADINGS) if _turns(offset, sigma[2]) else np.zeros(1)
    heading = mean[2] + sigma[2] * steps
    shift = gap + offset - turned(offset, heading)  # (H, P, 2) that brings each pair together, for each heading
    tried = np.concatenate([np.broadcast_to(mean[:2], (len(heading), 1, 2)), shift], axis=1)
    unlikely = (((tried - mean[:2]) / sigma[:2]) ** 2).sum(axis=-1) + (steps**2)[:, None]
    turn, pair = np.unravel_index(np.argmax(_VOTE * _votes(tried, shift) - unlikely / 2), unlikely.shape)
    return np.append(tried[turn, pair], heading[turn])


def _turns(offset: Floats, sigma_rad: float) -> bool:
    """Return whether an error of the heading moves boxes at these offsets (P, 2) enough to change a vote."""
    return bool(_SIGMAS * sigma_rad * np.abs(offset).max(initial=0.0) > _REACH_M / 4)


def _votes(tried: Floats, shift: Floats) -> Floats:
    """Return sums (H, T) over all P pairs of 1 - d^2 / reach^2, where positive; d is from (H, T, 2) to (H, P, 2)."""
    votes = tried @ (2 * shift.transpose(0, 2, 1))
    votes -= (tried**2).sum(axis=-1)[:, :, None]
    votes += (_REACH_M**2 - (shift**2).sum(axis=-1))[:, None]
    summed: Floats = np.maximum(votes, 0.0, out=votes).sum(axis=-1) / _REACH_M**2
    return summed


def _candidates(known: Floats, label: Ints, placed: PlacedBoxes, mean: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Return the gaps (P, 2) of pairs within an error of three sigmas, and their offsets (P, 2) from the agent."""
    gap = known[:, None] - placed.position
    offset = placed.position - placed.origin
    away = np.hypot(*(gap - (placed.corrected(mean) - placed.position)).transpose(2, 0, 1))
    reach = _SIGMAS * (np.hypot(*sigma[:2]) + sigma[2] * np.hypot(*offset.T)) + _REACH_M
    near = np.where(compatible(label, placed.label), away / reach, np.inf)
    rows, columns = np.nonzero(near <= 1)
    if len(rows) > _MOST_PAIRS:
        nearest = np.argpartition(near[rows, columns], _MOST_PAIRS)[:_MOST_PAIRS]
        rows, columns = rows[nearest], columns[nearest]
    return gap[rows, columns], offset[columns]


def compatible(one: Ints, other: Ints) -> Mask:
    """Return the mask (N, M) of labels (N,) and (M,) that may belong to the same object."""
    same: Mask = (one[:, None] == other) | (one == ANYTHING)[:, None] | (other == ANYTHING)
    return same


def common_objects(agents: Sequence[PlacedBoxes], corrections: Sequence[Floats], gate_m: float) -> CommonObjects:
    """Match each agent's boxes with the objects of all agents before it (Hungarian, distance up to `gate_m`).

    `corrections` are those (3,) of the agents' poses.
    """
    known, label = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    objects = []
    for placed, correction in zip(agents, corrections, strict=True):
        where = placed.corrected(correction)
        rows, columns = match(known, label, where, placed.label, gate_m)
        number = np.full(len(placed), -1)
        number[columns] = rows
        new = number < 0
        number[new] = len(known) + np.arange(np.count_nonzero(new))
        known, label = np.concatenate([known, where[new]]), np.concatenate([label, placed.label[new]])
        objects.append(number)
    agent = np.repeat(np.arange(len(agents)), [len(placed) for placed in agents])
    row = np.concatenate([np.arange(len(placed)) for placed in agents])
    return _shared(agent, row, np.concatenate(objects))


def match(known: Floats, label: Ints, where: Floats, labels: Ints, gate_m: float) -> tuple[Ints, Ints]:
    """Return the rows of `known` (N, 2) and of `where` (M, 2) that are the same objects."""
    near = gate_m**2 - ((known[:, None] - where) ** 2).sum(axis=-1)
    return hungarian(np.where(compatible(label, labels) & (near >= 0), near, -np.inf), 0.0)


def _shared(agent: Ints, row: Ints, number: Ints) -> CommonObjects:
    """Keep the objects that at least two agents saw, renumbered."""
    common = np.bincount(number) > 1
    order = np.argsort(number, kind="stable")
    order = order[common[number[order]]]
    return CommonObjects(agent[order], row[order], (np.cumsum(common) - 1)[number[order]])
