"""Knowledge distillation from an early teacher: a network that sees the points of all agents, now and without errors
(Li et al., "Learning Distilled Collaboration Graph for Multi-Agent Perception", NeurIPS 2021, section 3.3).

A recipe of a fusion that says `teacher: early` is trained by it, beside the head's losses. The fusion of that paper is
`DiscoNet`; any other may have a teacher, too.
"""

from __future__ import annotations

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.pillars import PillarBatch


def require_fitting(teacher: DetectorNet, detector: DetectorNet) -> None:
    """Check that a teacher's features can be compared with a fusion's.

    Args:
        teacher: on merged clouds.
        detector: that the fusion stands on.

    Raises:
        InvalidValueError: they differ in the number of features, the size of cells, or the number of sweeps.
    """
    for name in ("features", "cell_m", "sweeps"):
        one, other = getattr(teacher.config, name), getattr(detector.config, name)
        if one != other:
            raise InvalidValueError(f"teacher must have the detector's {name}, {other}, has {one}")


def teacher_loss(teacher: DetectorNet, merged: PillarBatch, fused: Tensor) -> Tensor:
    """Return how far a fused map is from the teacher's: the divergence of their channels, a mean over cells.

        sum_c t_c log(t_c / s_c),    t = softmax_c(teacher's features), s = softmax_c(fused features)

    Cells in which the fused map is zero, as nobody reports them, are left out.

    Args:
        teacher: not trained.
        merged: what it sees.
        fused: (1, features, h, w), after the neck.
    """
    with torch.no_grad():
        known = teacher.encoder(merged).float().log_softmax(1)
    reported = (fused.detach() != 0).any(1)
    found = fused.float().log_softmax(1)
    distance = (known.exp() * (known - found)).sum(1)
    mean: Tensor = (distance * reported).sum() / reported.sum().clamp_min(1)
    return mean
