"""Losses of unit vectors that are to tell objects apart: alike for one object, unlike for two.

Gu et al., "YOLOO: You Only Learn from Others Once", eq. 6 and 7.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

FIRST_LOG_SCALE = math.log(1 / 0.07)
"""Logarithm of one over the temperature at the beginning, as CLIP's."""

_MOST_LOG_SCALE = math.log(100.0)

MARGIN = 0.3
"""Margin of the triplets, as a difference of cosines. The source does not give its own."""


def paired_contrast(first: Tensor, second: Tensor, identity: Tensor, log_scale: Tensor) -> Tensor:
    """Return the symmetric InfoNCE loss of K pairs of unit vectors, a scalar (eq. 6); 0 without pairs.

    Each vector is to be nearest to the other one of its pair, among the other ones of all pairs. Vectors of the same
    identity are never told apart. (The source's sum over i and j is read as over pairs: i = j.)

    Args:
        first: (K, D).
        second: (K, D).
        identity: (K,) integers, equal for pairs of the same object.
        log_scale: () logarithm of one over the temperature; at most log(100), as CLIP's.
    """
    if not len(first):
        return (first.sum() + second.sum() + log_scale) * 0
    pair = torch.arange(len(first), device=first.device)
    repeated = (identity[:, None] == identity) & (pair[:, None] != pair)
    logits = (first @ second.T * log_scale.clamp(max=_MOST_LOG_SCALE).exp()).masked_fill(repeated, -math.inf)
    return (functional.cross_entropy(logits, pair) + functional.cross_entropy(logits.T, pair)) / 2


def hardest_triplets(vectors: Tensor, identity: Tensor, margin: float = MARGIN) -> Tensor:
    """Return the batch-hard triplet loss of M unit vectors, a scalar (eq. 7), by cosine distance.

    For each vector the farthest one of its identity is to be nearer than the nearest one of another identity, by the
    margin. Vectors without one or the other do not count; 0 if none has both.

    Args:
        vectors: (M, D).
        identity: (M,) integers.
        margin: the source's epsilon.
    """
    distance = 1 - vectors @ vectors.T
    same = identity[:, None] == identity
    other_self = same & ~torch.eye(len(same), dtype=torch.bool, device=same.device)
    usable = other_self.any(1) & ~same.all(1)
    if not bool(usable.any()):
        return vectors.sum() * 0
    farthest = distance.masked_fill(~other_self, -math.inf)[usable].amax(1)
    nearest = distance.masked_fill(same, math.inf)[usable].amin(1)
    return functional.relu(farthest - nearest + margin).mean()
