"""The Kalman filter of `coopsim.tracking.motion`, in torch, so that losses on its results reach the covariances.

The equations are those of `kalman`, on tensors of any floating type; results equal the library's.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.tracking.motion.constant_velocity import MEASURED, YAW

STATE = 10
"""x, y, z, l, w, h, yaw, vx, vy, vz."""


@dataclass(frozen=True, slots=True, eq=False)
class TensorBeliefs:
    """Gaussian beliefs about N objects: mean (N, 10), covariance (N, 10, 10)."""

    mean: Tensor
    covariance: Tensor

    def detach(self) -> TensorBeliefs:
        """Return the same beliefs, through which no gradient passes."""
        return TensorBeliefs(self.mean.detach(), self.covariance.detach())

    def at(self, rows: Tensor) -> TensorBeliefs:
        """Return the beliefs of some objects, by number (K,)."""
        return TensorBeliefs(self.mean[rows], self.covariance[rows])

    def put(self, rows: Tensor, others: TensorBeliefs) -> TensorBeliefs:
        """Return the beliefs with those of some objects (K,) replaced."""
        return TensorBeliefs(
            self.mean.index_copy(0, rows, others.mean), self.covariance.index_copy(0, rows, others.covariance)
        )


@dataclass(frozen=True, slots=True, eq=False)
class BoxFilter:
    """Constant-velocity filter of boxes, equal to `ConstantVelocity`.

    Attributes:
        growth_per_s: (7,) growth of the variances of boxes, per second.
        speed_growth_per_s: () growth of the variances of velocities.
        speed_variance: () variance of velocities, when a track begins.
    """

    growth_per_s: Tensor
    speed_growth_per_s: Tensor
    speed_variance: Tensor

    def initiate(self, boxes: Tensor, noise: Tensor) -> TensorBeliefs:
        """Return the beliefs after one measurement each: boxes (N, 7), with their covariances (N, 7, 7)."""
        still = boxes.new_zeros(len(boxes), STATE - MEASURED)
        unknown = torch.diag_embed(self.speed_variance.expand_as(still))
        wide = functional.pad(noise, (0, STATE - MEASURED, 0, STATE - MEASURED))
        return TensorBeliefs(
            torch.cat([boxes, still], dim=1), wide + functional.pad(unknown, (MEASURED, 0, MEASURED, 0))
        )

    def predict(self, beliefs: TensorBeliefs, dt_s: float) -> TensorBeliefs:
        """Return the beliefs `dt_s` >= 0 later: x' = F x, P' = F P F^T + Q."""
        transition = torch.eye(STATE, dtype=beliefs.mean.dtype, device=beliefs.mean.device)
        transition[[0, 1, 2], [7, 8, 9]] = dt_s
        process = torch.diag(torch.cat([self.growth_per_s, self.speed_growth_per_s.expand(STATE - MEASURED)]) * dt_s)
        return TensorBeliefs(
            beliefs.mean @ transition.T, transition @ beliefs.covariance @ transition.T + process.to(transition)
        )

    @staticmethod
    def update(beliefs: TensorBeliefs, innovation: Tensor, noise: Tensor) -> tuple[TensorBeliefs, Tensor]:
        """Return N beliefs after one more measurement each, in the Joseph form, and L (N, 7, 7) with L L^T = S = H P
        H^T + R.

        Args:
            beliefs: beliefs about N objects.
            innovation: (N, 7), from `innovation_of`.
            noise: (N, 7, 7) covariances of the measurements.
        """
        prior = beliefs.covariance
        factor = torch.linalg.cholesky(prior[:, :MEASURED, :MEASURED] + noise)
        gain = torch.cholesky_solve(prior[:, :MEASURED], factor).mT
        moved = beliefs.mean + (gain @ innovation[:, :, None])[:, :, 0]
        kept = prior - gain @ prior[:, :MEASURED]
        joseph = kept - kept[:, :, :MEASURED] @ gain.mT + gain @ noise @ gain.mT
        turned = torch.remainder(moved[:, YAW] + torch.pi, 2 * torch.pi) - torch.pi
        mean = torch.cat([moved[:, :YAW], turned[:, None], moved[:, MEASURED:]], dim=1)
        return TensorBeliefs(mean, (joseph + joseph.mT) / 2), factor


def innovation_of(beliefs: TensorBeliefs, boxes: Tensor) -> Tensor:
    """Return boxes (N, 7) less those believed; of headings only the axis counts, as in `update_beliefs`."""
    return axis_difference(boxes, beliefs.mean[:, :MEASURED])


def axis_difference(boxes: Tensor, others: Tensor) -> Tensor:
    """Return the difference (N, 7) of boxes, with headings that differ by at most a quarter of a turn."""
    difference = boxes - others
    turn = torch.remainder(difference[:, YAW] + torch.pi / 2, torch.pi) - torch.pi / 2
    return torch.cat([difference[:, :YAW], turn[:, None]], dim=1)


def squared_distance(innovation: Tensor, factor: Tensor) -> Tensor:
    """Return the squared Mahalanobis distances (N,) of innovations (N, 7), by the Cholesky factors of S (N, 7, 7)."""
    whitened: Tensor = torch.linalg.solve_triangular(factor, innovation[:, :, None], upper=False)
    return whitened.square().sum(dim=(1, 2))
