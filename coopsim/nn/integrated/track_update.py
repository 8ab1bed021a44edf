"""What becomes of tracks in a frame: paired with a detection, without one, or new."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs
from coopsim.nn.integrated.branch import turned_around
from coopsim.nn.queries.carry_over import corrected_velocity
from coopsim.nn.queries.instances import Instances
from coopsim.tracking.motion.turning import MOVING_M_S


def updated_tracks(predicted: Instances, detected: Instances, pairs: Pairs, born: Tensor, dt_s: float) -> Instances:
    """Return the tracks of a frame: first those with a detection, then those without, then new ones, unnumbered.

    A pair is at the detection's box, and has its score, class and features, which ask for it in the next frame (eq.
    17). Its velocity is the predicted one, corrected by how far the detection lies beside the prediction. Detections
    confuse front and back, so a pair that moves faces forwards, and one that stands faces as the prediction does. What
    has no detection stays as it is predicted.

    Args:
        predicted: the tracks, where they are predicted to be.
        detected: what is detected, in the same frame.
        pairs: P rows of `predicted`, and of `detected`.
        born: (K,) rows of `detected` that begin tracks.
        dt_s: time since the frame before.
    """
    rows, columns = (torch.from_numpy(each).to(predicted.box.device) for each in pairs)
    known, now = predicted[rows], detected[columns]
    velocity = corrected_velocity(known, now, dt_s)
    box, missed = _faced(now.box, known.box, velocity), torch.zeros_like(known.missed)
    paired = replace(now, box=box, velocity=velocity, hits=known.hits + 1, missed=missed, number=known.number)
    left = torch.ones(len(predicted), dtype=torch.bool, device=rows.device)
    left[rows] = False
    alone = predicted[left]
    return Instances.joined([paired, replace(alone, missed=alone.missed + 1), detected[born]])


def _faced(box: Tensor, known: Tensor, velocity: Tensor) -> Tensor:
    """Return boxes (P, 7), turned by half a turn where they face neither forwards nor as those known (P, 7)."""
    forwards = torch.atan2(velocity[:, 1], velocity[:, 0])
    facing = torch.where(velocity.norm(dim=1) > MOVING_M_S, forwards, known[:, 6])
    return turned_around(box, torch.cos(box[:, 6] - facing) < 0)
