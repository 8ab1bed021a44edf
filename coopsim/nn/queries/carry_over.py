"""Instances carried over from frame to frame: moved on by their velocities, and met with what is seen now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.nn.queries.instance_decoder import logit
from coopsim.nn.queries.instances import Instances
from coopsim.types.taxonomy import ObjectClass

LONGEST_S = 2.0
"""After a longer time without a frame, instances are forgotten."""

_FASTEST_M_S = {
    ObjectClass.MOTORCYCLE: 15.0, ObjectClass.BICYCLE: 8.0, ObjectClass.SCOOTER: 8.0, ObjectClass.PEDESTRIAN: 3.0,
    ObjectClass.CHILD: 3.0,
}  # fmt: skip
_FASTEST = np.array([_FASTEST_M_S.get(cls, 20.0) for cls in ObjectClass])
_GROUPS = np.array([0 if cls not in _FASTEST_M_S else 1 if _FASTEST_M_S[cls] > 5 else 2 for cls in ObjectClass])
_LEAST_REACH_M, _CHANGE_M_S = 1.0, 4.0

_FIRST_GAIN_S, _GAIN_S = 0.15, 0.5
"""A difference of places says dt / (dt + this) of a velocity: the less, the closer in time the frames are."""

_MOST_M_S = 40.0
_FADE = 1.0
"""What the logit of a score loses in a frame in which nobody sees the object."""


def met(prior: Instances, seen: Instances, dt_s: float) -> Instances:
    """Return the instances of a frame: those carried over, at what is seen of them now, and new ones.

    Pairs have the smallest distances (Hungarian), within a reach that is wide while the velocity is not known yet. A
    pair keeps the history, features and number of what was carried over, and has box, score and class of what is
    seen; its velocity is corrected by how far it lies beside the prediction. What is not seen stays for a while where
    it is predicted, and is believed in less and less.

    Args:
        prior: `advanced` to now, in the frame of `seen`.
        seen: by the agent alone, now.
        dt_s: time since the frame before.
    """
    rows, columns = _pairs(prior, seen, dt_s)
    device = seen.box.device
    old, new = (torch.from_numpy(each).to(device) for each in (rows, columns))
    fresh = torch.ones(len(seen), dtype=torch.bool, device=device)
    fresh[new] = False
    known, now = prior[old], seen[new]
    left = prior[_others(old, len(prior))]
    paired = replace(
        known, box=now.box, velocity=corrected_velocity(known, now, dt_s), score=now.score, label=now.label,
        hits=known.hits + 1, missed=torch.zeros_like(known.missed),
    )  # fmt: skip
    faded = replace(left, score=torch.sigmoid(logit(left.score) - _FADE), missed=left.missed + 1)
    return Instances.joined([paired, faded, seen[fresh]])


def _pairs(prior: Instances, seen: Instances, dt_s: float) -> Pairs:
    label, other = prior.label.cpu().numpy(), seen.label.cpu().numpy()
    unknown = prior.hits.cpu().numpy() == 1
    reach_m = _LEAST_REACH_M + dt_s * np.where(unknown, _FASTEST[label], _CHANGE_M_S)
    away_m = torch.cdist(prior.box[:, :2].detach().double(), seen.box[:, :2].detach().double()).cpu().numpy()
    possible = (away_m <= reach_m[:, None]) & (_GROUPS[label][:, None] == _GROUPS[other])
    return hungarian(np.where(possible, -away_m, -np.inf), -np.inf)


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
