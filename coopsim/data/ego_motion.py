"""Motion of a recording car, estimated from the boxes that it detects.

A recording without poses still shows how its car moved: boxes of standing objects move the other way. Each frame is
aligned to a map of the last second's boxes, as scan matching aligns points (compare KISS-ICP, Vizzo et al., RA-L 2023).
Let x = (vx, vy, turn rate) be the car's motion, m_j the map's positions in the last base frame, z_i the boxes' in
the current one. The estimate maximizes

    log p(x) + sum_i log(OUTLIER + max_j exp(-d_ij(x)^2 / 2)),

where d_ij is the distance between m_j and z_i moved by x, in standard deviations, over pairs of one class. A moving
object matches nothing, so it costs log OUTLIER and pulls nowhere. The prior p(x) is constant motion with bounded
acceleration, mixed with a wide one of little weight: many boxes can overrule a wrong past, a few cannot. Without
boxes the prior alone remains: the car goes on as before.

Objects that all move alike look like standing ones: in a frame that shows only people walking in one direction, the
error is their speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, Ints, Mask

BOX_M = 0.25
"""Standard deviation of a detected position; detectors on LiDAR err by 0.1 m to 0.3 m."""

ACCELERATION = np.array([3.0, 3.0, 0.5])
"""Standard deviation of the change of motion in a second: m/s^2, m/s^2, rad/s^2. Brisk driving, not an emergency."""

ANY_MOTION = np.array([15.0, 15.0, 0.3])
"""Standard deviation of the motion of a car of which nothing is known: m/s, m/s, rad/s. Town traffic."""

OUTLIER = 0.02
"""Likelihood of a box that matches nothing, relative to a perfect match: that of 2.8 standard deviations."""

LOST = 1e-3
"""Prior probability of a frame that the past estimate is wrong."""

STANDS_M = 0.06
"""Growth in a second of the standard deviation of a map position: what stands may start to move."""

MEMORY_S = 1.0
"""Time for which an unseen position stays in the map."""

GATE = 3.0
"""Largest distance, in standard deviations, at which a box updates a map position."""

_CANDIDATES, _REFINED, _ITERATIONS = 60, 3, 6


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    """A weighted normal density of motions.

    Attributes:
        mean: (3,).
        information: (3, 3) inverse of the covariance.
        log_weight: logarithm of its weight.
        log_volume: logarithm of the covariance's determinant.
    """

    mean: Floats
    information: Floats
    log_weight: float
    log_volume: float

    @classmethod
    def of(cls, weight: float, mean: Floats, covariance: Floats) -> _Prior:
        """Return the density with a covariance (3, 3)."""
        information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        return cls(mean, information, float(np.log(weight)), float(np.linalg.slogdet(covariance)[1]))

    def log(self, motions: Floats) -> Floats:
        """Return the log density (C,) at motions (C, 3), without its constant."""
        offset = motions - self.mean
        squared = np.einsum("ci,ij,cj->c", offset, self.information, offset)
        log_density: Floats = self.log_weight - (squared + self.log_volume) / 2
        return log_density


class EgoMotion:
    """Causal estimator of one car's planar motion; give it each frame's detections in turn."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self._wide = np.diag(ANY_MOTION**2)
        self._motion, self._covariance = np.zeros(3), self._wide
        self._at, self._label = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)  # the map, in the current base frame
        self._variance, self._unseen_s = np.zeros(0), np.zeros(0)

    def step(self, detections: Detections) -> Floats:
        """Return the motion (3,) since the last frame: x, y m and heading rad, in that frame. The first one is zero."""
        boxes, label = detections.boxes.center[:, :2], detections.label
        self._covariance = self._covariance + np.diag((ACCELERATION * self._dt_s) ** 2)
        self._estimate(boxes, label)
        moved: Floats = self._motion * self._dt_s
        self._at = (self._at - moved[:2]) @ _rotation(moved[2])
        self._update_map(boxes, label)
        return moved

    def _estimate(self, boxes: Floats, label: Ints) -> None:
        same = label[:, None] == self._label
        if not same.any():
            return
        priors = _Prior.of(1 - LOST, self._motion, self._covariance), _Prior.of(LOST, np.zeros(3), self._wide)
        candidates = self._candidates(boxes, same)
        best = np.argsort(-self._log_posterior(candidates, boxes, same, priors), kind="stable")[:_REFINED]
        motions, information = self._refine(candidates[best], boxes, same, priors)
        likeliest = int(np.argmax(self._log_posterior(motions, boxes, same, priors)))
        self._motion, self._covariance = motions[likeliest], np.linalg.inv(information[likeliest])

    def _candidates(self, boxes: Floats, same: Mask) -> Floats:
        """Return motions (C, 3): as predicted, and those that put a box exactly on a position of the map."""
        steps = self._at - (boxes @ _rotation(self._motion[2] * self._dt_s).T)[:, None]
        speeds = steps[same & (np.hypot(steps[..., 0], steps[..., 1]) < 3 * ANY_MOTION[0] * self._dt_s)] / self._dt_s
        if len(speeds) > _CANDIDATES:
            speeds = speeds[np.linspace(0, len(speeds) - 1, _CANDIDATES).astype(np.int64)]
        turning = np.full(len(speeds), self._motion[2])
        return np.vstack([self._motion, np.column_stack([speeds, turning])])

    def _distances(self, motions: Floats, boxes: Floats, same: Mask) -> tuple[Floats, Floats]:
        """Return the boxes moved by each motion (C, N, 2), and their squared distances to the map (C, N, M).

        A vague position has a lower density, which counts as distance.
        """
        angle = motions[:, 2, None] * self._dt_s
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = boxes.T
        moved = np.stack([cos * x - sin * y, sin * x + cos * y], axis=2) + motions[:, None, :2] * self._dt_s
        variance = BOX_M**2 + self._variance
        offset = moved[:, :, None] - self._at
        squared = np.einsum("cnmk,cnmk->cnm", offset, offset) / variance + 2 * np.log(variance / BOX_M**2)
        return moved, np.where(same, squared, np.inf)

    def _log_posterior(self, motions: Floats, boxes: Floats, same: Mask, priors: tuple[_Prior, _Prior]) -> Floats:
        _, squared = self._distances(motions, boxes, same)
        likelihood: Floats = np.log(OUTLIER + np.exp(-squared.min(axis=2) / 2)).sum(axis=1)
        return likelihood + np.logaddexp(priors[0].log(motions), priors[1].log(motions))

    def _refine(
        self, motions: Floats, boxes: Floats, same: Mask, priors: tuple[_Prior, _Prior]
    ) -> tuple[Floats, Floats]:
        """Return the maximum nearest to each motion (C, 3) by reweighted least squares (Gauss-Newton), and the maxima's
        information matrices (C, 3, 3).
        """
        dt_s, (past, wide) = self._dt_s, priors
        rows, numbers = np.arange(len(boxes)), np.arange(len(motions))[:, None]
        jacobian = np.zeros((len(motions), len(boxes), 2, 3))
        jacobian[..., 0, 0] = jacobian[..., 1, 1] = dt_s
        for _ in range(_ITERATIONS):
            chosen = [past if as_past else wide for as_past in past.log(motions) >= wide.log(motions)]
            moved, squared = self._distances(motions, boxes, same)
            nearest = squared.argmin(axis=2)
            match = np.exp(-squared[numbers, rows, nearest] / 2)
            weight = match / (match + OUTLIER) / (BOX_M**2 + self._variance[nearest])
            offset = self._at[nearest] - moved
            arm = moved - motions[:, None, :2] * dt_s
            jacobian[..., 0, 2], jacobian[..., 1, 2] = -arm[..., 1] * dt_s, arm[..., 0] * dt_s
            information, pull = np.empty((len(motions), 3, 3)), np.empty((len(motions), 3))
            for k, prior in enumerate(chosen):
                pull[k] = prior.information @ (prior.mean - motions[k])
                pull[k] += np.einsum("n,nki,nk->i", weight[k], jacobian[k], offset[k])
                information[k] = prior.information + np.einsum("n,nki,nkj->ij", weight[k], jacobian[k], jacobian[k])
            motions = motions + np.linalg.solve(information, pull[..., None])[..., 0]
        return motions, information

    def _update_map(self, boxes: Floats, label: Ints) -> None:
        """Average matched positions (a Kalman filter of standing objects), add unmatched boxes, drop old ones."""
        self._unseen_s = self._unseen_s + self._dt_s
        self._variance = self._variance + STANDS_M**2 * self._dt_s
        box, position = self._matches(boxes, label)
        gain = self._variance[position] / (self._variance[position] + BOX_M**2)
        self._at[position] += gain[:, None] * (boxes[box] - self._at[position])
        self._variance[position] *= 1 - gain
        self._unseen_s[position] = 0.0
        kept = self._unseen_s < MEMORY_S - self._dt_s / 2
        new = np.setdiff1d(np.arange(len(boxes)), box)
        self._at = np.vstack([self._at[kept], boxes[new]])
        self._label = np.append(self._label[kept], label[new])
        self._variance = np.append(self._variance[kept], np.full(len(new), BOX_M**2))
        self._unseen_s = np.append(self._unseen_s[kept], np.zeros(len(new)))

    def _matches(self, boxes: Floats, label: Ints) -> tuple[Ints, Ints]:
        """Return pairs of boxes and positions that are each other's nearest of one class, within the gate."""
        if not len(boxes) or not len(self._at):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        offset = boxes[:, None] - self._at
        squared = np.einsum("nmk,nmk->nm", offset, offset) / (BOX_M**2 + self._variance)
        squared[label[:, None] != self._label] = np.inf
        nearest, rows = squared.argmin(axis=1), np.arange(len(boxes))
        mutual = (squared.argmin(axis=0)[nearest] == rows) & (squared[rows, nearest] < GATE**2)
        return rows[mutual], nearest[mutual]


def _rotation(angle_rad: float) -> Floats:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
