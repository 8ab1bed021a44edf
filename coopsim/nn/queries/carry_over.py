"""Instances carried over from frame to frame: moved on by their velocities, and met with what is seen now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.geometry.se3 import Floats
from coopsim.nn.queries.instance_decoder import logit
from coopsim.nn.queries.instances import Instances
from coopsim.types.taxonomy import ObjectClass
from coopsim.types.units import Mask

LONGEST_S = 2.0
"""After a longer time without a frame, instances are forgotten."""

_FASTEST_M_S = {
    ObjectClass.MOTORCYCLE: 15.0, ObjectClass.BICYCLE: 8.0, ObjectClass.SCOOTER: 8.0, ObjectClass.PEDESTRIAN: 3.0,
    ObjectClass.CHILD: 3.0,
}  # fmt: skip
_FASTEST = np.array([_FASTEST_M_S.get(cls, 20.0) for cls in ObjectClass])
_GROUPS = np.array([0 if cls not in _FASTEST_M_S else 1 if _FASTEST_M_S[cls] > 5 else 2 for cls in ObjectClass])
_LEAST_REACH_M, _CHANGE_M_S = 1.0, 4.0

_MOST_M_S = 40.0
_YOUNG_HITS = 3
"""Until so many sightings the velocity of what drives on a motorway may still be far from known."""

_ALIGNED = 0.5
"""Largest sine of the angle between the headings of two sightings of it; boxes may be turned around."""

_FIRST_GAIN_S, _GAIN_S = 0.15, 0.5
"""A difference of places says dt / (dt + this) of a velocity: the less, the closer in time the frames are."""

_FADE = 1.0
"""What the logit of a score loses in a frame in which nobody sees the object."""


def met(prior: Instances, seen: Instances, dt_s: float) -> Instances:
    """Return the instances of a frame: those carried over, at what is seen of them now, and new ones.

    Pairs have the smallest distances (Hungarian), within a reach that is wide while the velocity is not known yet.
    Vehicles that are left over are paired as if they were fast: those known for a few frames with what is ahead of or
    behind them in their direction. A pair keeps the history, features and number of what was carried over, and has
    box, score and class of what is seen; its velocity is corrected by how far it lies beside the prediction. What is
    not seen stays for a while where it is predicted, and is believed in less and less.

    Args:
        prior: `advanced` to now, in the frame of `seen`.
        seen: by the agent alone, now.
        dt_s: time since the frame before.
    """
    usual, fast = _pairs(prior, seen, dt_s)
    device = seen.box.device
    old, new = (torch.from_numpy(np.concatenate(each)).to(device) for each in zip(usual, fast, strict=True))
    fresh = torch.ones(len(seen), dtype=torch.bool, device=device)
    fresh[new] = False
    known, now = prior[old], seen[new]
    velocity = corrected_velocity(known, now, dt_s)
    if count := len(fast[0]):  # has moved so far that errors of places are small beside it
        beside = now.box[-count:, :2] - known.box[-count:, :2]
        velocity[-count:] = (known.velocity[-count:] + beside / dt_s).clamp(-_MOST_M_S, _MOST_M_S)
    left = prior[_others(old, len(prior))]
    paired = replace(
        known, box=now.box, velocity=velocity, score=now.score, label=now.label,
        hits=known.hits + 1, missed=torch.zeros_like(known.missed),
    )  # fmt: skip
    faded = replace(left, score=torch.sigmoid(logit(left.score) - _FADE), missed=left.missed + 1)
    return Instances.joined([paired, faded, seen[fresh]])


def _pairs(prior: Instances, seen: Instances, dt_s: float) -> tuple[Pairs, Pairs]:
    """Return the pairs of usual speed, and those of what is left over that are fast."""
    alike = _GROUPS[prior.label.cpu().numpy()][:, None] == _GROUPS[seen.label.cpu().numpy()]
    away_m = torch.cdist(prior.box[:, :2].detach().double(), seen.box[:, :2].detach().double()).cpu().numpy()
    near = alike & (away_m <= _reach_m(prior, dt_s)[:, None])
    rows, columns = _nearest(near, away_m)
    fast = alike & _fast(prior, seen, dt_s)
    fast[rows], fast[:, columns] = False, False
    return (rows, columns), _nearest(fast, away_m)


def _nearest(possible: Mask, away_m: Floats) -> Pairs:
    return hungarian(np.where(possible, -away_m, -np.inf), -np.inf)


def _reach_m(prior: Instances, dt_s: float) -> Floats:
    """Return how far from its prediction each object of usual speed may be, (K,) m."""
    unknown, fastest = prior.hits.cpu().numpy() == 1, _FASTEST[prior.label.cpu().numpy()]
    reach_m: Floats = _LEAST_REACH_M + dt_s * np.where(unknown, fastest, _CHANGE_M_S)
    return reach_m


def _fast(prior: Instances, seen: Instances, dt_s: float) -> Mask:
    """Return which vehicles (K, L) can be the same if they are as fast as on a motorway."""
    vehicle, young = _GROUPS[prior.label.cpu().numpy()] == 0, prior.hits.cpu().numpy() <= _YOUNG_HITS
    old, new = (each.box.detach().double().cpu().numpy() for each in (prior, seen))
    x, y = np.moveaxis(new[None, :, :2] - old[:, None, :2], 2, 0)
    cos, sin = np.cos(old[:, 6:]), np.sin(old[:, 6:])
    ahead_m, aside_m = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    aligned = np.abs(np.sin(new[None, :, 6] - old[:, 6:])) <= _ALIGNED
    possible: Mask = aligned & (ahead_m <= _LEAST_REACH_M + dt_s * _MOST_M_S) & (aside_m <= _LEAST_REACH_M)
    possible &= (vehicle & young)[:, None]
    return possible


def corrected_velocity(known: Instances, now: Instances, dt_s: float) -> Tensor:
    """Return velocities (P, 2): those of `known`, corrected by how far what is seen of them now lies beside them."""
    gain_s = torch.where(known.hits == 1, _FIRST_GAIN_S, _GAIN_S)[:, None]
    beside = now.box[:, :2] - known.box[:, :2]
    return (known.velocity + beside / (dt_s + gain_s)).clamp(-_MOST_M_S, _MOST_M_S)


def _others(rows: Tensor, count: int) -> Tensor:
    """Return the rows of `count` that are not among `rows`."""
    kept = torch.ones(count, dtype=torch.bool, device=rows.device)
    kept[rows] = False
    return torch.nonzero(kept).squeeze(1)
