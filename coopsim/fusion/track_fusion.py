"""Track-to-track fusion by covariance intersection: two agents' tracks become one set, each object at most once.

Two agents' tracks of one object are correlated (the same motion model, the same object's maneuvers) by an unknown
amount. A Kalman update takes them for independent and becomes overconfident; covariance intersection is consistent
whatever the correlation is.
"""

from __future__ import annotations

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.arrays import require_finite
from coopsim.support.kernels import njit
from coopsim.types import Ints, Tracks
from coopsim.types.track_estimates import TrackEstimates


def fuse_tracks(own: TrackEstimates, other: TrackEstimates, gate: float) -> tuple[TrackEstimates, Ints]:
    """Match tracks of the same class (Hungarian, BEV GIoU), intersect the pairs, add the rest.

    Positions are not compared by their covariance: the velocity of a track that has just begun is unknown, so as soon
    as it is predicted it would match everything around it.

    The N own tracks keep their ids and their order; the M others are in the same frame at the same time. Return the
    fused tracks (N + new,) and the row (M,) of each of the others among them.
    """
    a, b = own.tracks, other.tracks
    affinity = np.where(a.label[:, None] == b.label, giou_bev(a.boxes.array, b.boxes.array), -np.inf)
    mine, theirs = hungarian(affinity, gate)
    unmatched = np.ones(len(other), dtype=bool)
    unmatched[theirs] = False
    new = np.flatnonzero(unmatched)
    where = np.empty(len(other), dtype=np.int64)
    where[theirs], where[new] = mine, len(own) + np.arange(len(new))
    if not len(mine):
        return TrackEstimates.concatenate([own, other[new]]), where
    whole = TrackEstimates.concatenate([own, other[new], _intersected(own[mine], other[theirs])])
    order = np.arange(len(own) + len(new))
    order[mine] = len(order) + np.arange(len(mine))
    return whole[order], where


def _intersected(first: TrackEstimates, second: TrackEstimates) -> TrackEstimates:
    """Fuse each pair: planar states by covariance intersection, height and size by the same weight.

    The heading is averaged as an axis and the front of the first's box stays in front: a mean of headings would turn
    around where the two confuse front and back. The score is the better one.
    """
    mean, covariance, weight = covariance_intersection(first.mean, first.covariance, second.mean, second.covariance)
    a, b = first.tracks.boxes, second.tracks.boxes
    first_weight = weight[:, None]
    turn = (b.yaw - a.yaw + np.pi / 2) % np.pi - np.pi / 2
    boxes = Boxes3D.trusted(
        first_weight * a.center + (1 - first_weight) * b.center,
        first_weight * a.size + (1 - first_weight) * b.size,
        wrap_angle(a.yaw + (1 - weight) * turn),
    )
    score = np.maximum(first.tracks.score, second.tracks.score)
    tracks = Tracks.trusted(first.tracks.id, boxes, first.tracks.velocity, score, first.tracks.label)
    return TrackEstimates.trusted(tracks, covariance).with_planar_states(mean, covariance)


PULL = 1e-3
"""Weight of (w - 1/2)^2 relative to log det P. It costs at most PULL / 4 = 0.025 % of the determinant, and makes a tie
the mean: without it rounding would decide between two equally certain estimates, differently in each frame."""

_HALVINGS = 45  # of an interval of length 1: as fine as double precision resolves next to 1/2


def covariance_intersection(
    first: Floats, first_covariance: Floats, second: Floats, second_covariance: Floats
) -> tuple[Floats, Floats, Floats]:
    """Fuse by P^-1 = w A^-1 + (1 - w) B^-1 and P^-1 c = w A^-1 a + (1 - w) B^-1 b (Julier and Uhlmann, ACC 1997).

    P is at least the covariance of c, for every correlation of a and b, if A and B are at least theirs. The weight
    minimises det P, which, unlike the trace, does not depend on the units of metres and metres per second. Means are
    (N, n) and covariances (N, n, n); the result is c, P, and w (N,), the weight of the first, in [0, 1].

    Raises:
        InvalidValueError: a covariance is not finite and positive definite.
    """
    weight = intersection_weight(first_covariance, second_covariance)
    first_weight = weight[:, None, None]
    information_a = first_weight * np.linalg.inv(first_covariance)
    information_b = (1 - first_weight) * np.linalg.inv(second_covariance)
    covariance = np.linalg.inv(information_a + information_b)
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    weighted = information_a @ first[:, :, None] + information_b @ second[:, :, None]
    return (covariance @ weighted)[:, :, 0], covariance, weight


def intersection_weight(first_covariance: Floats, second_covariance: Floats) -> Floats:
    """Return the weight w of the first, (N,) in [0, 1], that minimises log det P + PULL (w - 1/2)^2, of (N, n, n).

    With l the eigenvalues of B A^-1, log det P is a constant less the sum of log(1 + w (l - 1)): convex in w, and its
    derivative needs no inverse, so halving the interval finds its zero.

    Raises:
        InvalidValueError: a covariance is not finite and positive definite.
    """
    # A = F F^T, B = G G^T: B A^-1 has the eigenvalues of (F^-1 G)(F^-1 G)^T.
    whitened = np.linalg.solve(_factor(first_covariance), _factor(second_covariance))
    excess = np.asarray(np.linalg.svd(whitened, compute_uv=False) ** 2 - 1, dtype=np.float64)
    weight: Floats = _weights(excess)
    return weight


@njit(cache=True, nogil=True)
def _weights(excess: Floats) -> Floats:
    """Return the weight (N,) at which the derivative for each row of l - 1 (N, n) is zero."""
    weight = np.empty(len(excess))
    for row in range(len(excess)):
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle, falls = (low + high) / 2, 0.0
            for each in excess[row]:
                falls += each / (1 + middle * each)
            slope = 2 * PULL * (middle - 0.5) - falls
            low, high = middle if slope <= 0 else low, middle if slope >= 0 else high
        weight[row] = (low + high) / 2
    return weight


def _factor(covariance: Floats) -> Floats:
    """Return the Cholesky factors, (N, n, n)."""
    try:
        factor = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise InvalidValueError("covariances to intersect must be positive definite") from error
    require_finite(factor, "factor of a covariance to intersect")
    return factor
