"""What becomes of tracks in a frame: paired with a detection, without one, or new."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs
from coopsim.nn.queries.carry_over import corrected_velocity
from coopsim.nn.queries.instances import Instances


def updated_tracks(predicted: Instances, detected: Instances, pairs: Pairs, born: Tensor, dt_s: float) -> Instances:
    """Return the tracks of a frame: first those with a detection, then those without, then new ones, unnumbered.

    A pair is at the detection's box, and has its score, class and features, which ask for it in the next frame (eq.
    17). Its velocity is the predicted one, corrected by how far the detection lies beside the prediction. What has no
    detection stays as it is predicted.

    Args:
        predicted: the tracks, where they are predicted to be.
        detected: what is detected, in the same frame.
        pairs: P rows of `predicted`, and of `detected`.
        born: (K,) rows of `detected` that begin tracks.
        dt_s: time since the frame before.
    """
    rows, columns = (torch.from_numpy(each).to(predicted.box.device) for each in pairs)
    known, now = predicted[rows], detected[columns]
    paired = replace(
        now, velocity=corrected_velocity(known, now, dt_s), hits=known.hits + 1, missed=torch.zeros_like(known.missed),
        number=known.number,
    )  # fmt: skip
    left = torch.ones(len(predicted), dtype=torch.bool, device=rows.device)
    left[rows] = False
    alone = predicted[left]
    return Instances.joined([paired, replace(alone, missed=alone.missed + 1), detected[born]])
