"""Pose correction from shared objects: robust least squares on a graph of agents and objects.

The idea is CoAlign's (Lu et al., "Robust Collaborative 3D Object Detection in Presence of Pose Errors", ICRA 2023, eq.
3-5): agents and objects are vertices, boxes are edges, and the solution is the poses under which all boxes of an object
agree. Here with a prior for every pose, a robust loss, and without the boxes' headings: they are off by degrees and
sometimes by half a turn, poses by tenths of a degree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_STEPS = 3
_SETTLED = 1e-3
"""m and rad; iteration ends after a step this small."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraph:
    """N boxes of A + 1 agents on K objects. The stated pose of agent 0 is taken to be right, those of A others are not.

    Attributes:
        offset: (N, 2) m, from the agent that saw the box to the box, along the axes of the common frame.
        origin: (N, 2) m, stated position of that agent.
        agent: (N,) number of that agent, in 0..A.
        object: (N,) number of the object in 0..K - 1, not falling, each at least once.
    """

    offset: Floats
    origin: Floats
    agent: Ints
    object: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """Corrections of A poses.

    Attributes:
        mean: (A, 3) x, y m and heading rad, to be added to the stated poses.
        covariance: (A, 3, 3).
    """

    mean: Floats
    covariance: Floats


def align(graph: PoseGraph, prior: Corrections, box_noise_m: float) -> Corrections:
    """Return the most likely corrections of the poses.

    With box n of agent a on object k at q_n = t_a + d_a + R(h_a) offset_n, minimised over corrections c_a = (d_a, h_a)
    and objects o_k is

        sum_n rho(|q_n - o_k|^2 / s^2) + sum_a (c_a - m_a)^T P_a^-1 (c_a - m_a),    rho(z) = log(1 + z),

    by Gauss-Newton with the weights 1 / (1 + z) that the Cauchy loss has (iteratively reweighted least squares; Barron,
    "A General and Adaptive Robust Loss Function", CVPR 2019, has its family). Objects are eliminated: given the
    rest, each is the weighted mean of its boxes, and the normal equations of the poses are the Schur complement.

    The prior is m and P, where a pose without common objects stays; s is `box_noise_m`, the standard deviation of a
    box's x and of its y. Objects of one agent alone carry no information and do no harm.
    """
    inverse: Floats = np.linalg.inv(prior.covariance).astype(np.float64)
    information = _block_diagonal(inverse)
    first = np.flatnonzero(np.diff(graph.object, prepend=-1))
    mean, weight = prior.mean.copy(), np.ones(len(graph.object))
    for _ in range(_STEPS):
        place, jacobian = _linearized(graph, mean)
        apart = place - _of_object(place, weight, graph.object, first)
        weight = 1 / (box_noise_m**2 + (apart**2).sum(axis=1))
        inner = jacobian - _of_object(jacobian, weight, graph.object, first)
        weighted = (weight[:, None, None] * inner).reshape(-1, inner.shape[2]).T
        normal = weighted @ inner.reshape(weighted.shape[1], -1) + information
        pull = np.einsum("aij,aj->ai", inverse, prior.mean - mean).ravel()
        # The objects' mean need not be subtracted here: `weighted` is orthogonal to all means.
        step = np.linalg.solve(normal, pull - weighted @ place.ravel()).reshape(mean.shape)
        mean += step
        if np.abs(step).max() < _SETTLED:
            break
    count = len(mean)
    return Corrections(mean, np.einsum("aiaj->aij", np.linalg.inv(normal).reshape(count, 3, count, 3)))


def _linearized(graph: PoseGraph, mean: Floats) -> tuple[Floats, Floats]:
    """Return the positions of the boxes (N, 2) and their derivatives by all poses (N, 2, 3 A)."""
    correction = np.concatenate([np.zeros((1, 3)), mean])[graph.agent]
    cos, sin = np.cos(correction[:, 2]), np.sin(correction[:, 2])
    x, y = graph.offset.T
    arm = np.column_stack([x * cos - y * sin, x * sin + y * cos])
    jacobian = np.zeros((len(arm), 2, len(mean), 3))
    moved = np.flatnonzero(graph.agent)
    of = graph.agent[moved] - 1
    jacobian[moved, 0, of, 0] = jacobian[moved, 1, of, 1] = 1.0
    jacobian[moved, 0, of, 2], jacobian[moved, 1, of, 2] = -arm[moved, 1], arm[moved, 0]
    return graph.origin + correction[:, :2] + arm, jacobian.reshape(len(arm), 2, -1)


def _of_object(values: Floats, weight: Floats, number: Ints, first: Ints) -> Floats:
    """Return the weighted mean (N, ...) over all boxes on each box's object; `first` (K,) is each object's first."""
    whole = weight.reshape(-1, *[1] * (values.ndim - 1))
    mean: Floats = np.add.reduceat(whole * values, first, axis=0) / np.add.reduceat(whole, first, axis=0)
    return mean[number]


def _block_diagonal(blocks: Floats) -> Floats:
    """Return the block-diagonal matrix (3 A, 3 A) of blocks (A, 3, 3)."""
    count = len(blocks)
    whole = np.zeros((count, 3, count, 3))
    whole[np.arange(count), :, np.arange(count), :] = blocks
    return whole.reshape(3 * count, 3 * count)
