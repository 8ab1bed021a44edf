"""MADE: two tests of each sender, of what its message does to the result and of how its map is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.defenses.made_calibration import MATCH_LOSS, RECONSTRUCTION
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import DEFENSES, Defense, Reception, Trust
from coopsim.support.checks import require_count, require_positive, require_probability
from coopsim.types import Detections, FeatureMap, Mask

_PATCH, _FEWEST = 3, 64
"""Cells along each side of a patch of a map, and fewest patches of which something can be said."""


@DEFENSES.register("made")
@dataclass(kw_only=True, eq=False)
class Made(Defense):
    """Two tests of each sender, with the false discoveries controlled (Zhao et al., "Malicious Agent Detection for
    Robust Multi-Agent Collaborative Perception", IROS 2024: MADE).

    The match loss is the cost of the best matching of what the receiver finds alone and with this sender's message: 1 -
    IoU of each pair, and 1 for each box without one. The reconstruction loss says how badly a map of features is
    reconstructed by an autoencoder that knows honest maps. Each loss is compared with those of honest senders, which
    gives a conformal p-value, and the procedure of Benjamini and Hochberg (1995) decides over both.

    The paper's autoencoder is a network on differences of maps, trained for one encoder. Here it is linear, principal
    components of patches of 3 x 3 cells, and fitted in each frame to the receiver's own map, which comes from the same
    encoder and is honest. So it needs no training, and the loss is relative to that of the own map. Messages without a
    map have the first test alone. The sender's trust falls with its adjusted p-value, and is 0.5 at `level`.

    Attributes:
        level: rate of false discoveries, the paper's 0.05.
        near_m: distance from the receiver within which boxes count.
        components: principal components of a patch that honest maps keep.
    """

    level: float = 0.05
    near_m: float = 50.0
    components: int = 16

    def __post_init__(self) -> None:
        require_probability(level=self.level)
        require_positive(level=self.level, near_m=self.near_m)
        require_count(1, components=self.components)
        self._trust: dict[str, float] = {}

    def judge(self, reception: Reception) -> Trust:
        basis = None
        for claim in reception.claims:
            if not claim.is_new:
                continue
            loss = self._match_loss(reception.own, reception.find([claim.sender]))
            values = [p_value(loss, MATCH_LOSS[reception.fuses_maps])]
            if (content := claim.features()) is not None:
                basis = basis or self._own_basis(reception)
                ratio = self._reconstruction(content, basis)
                values += [] if ratio is None else [p_value(ratio, RECONSTRUCTION)]
            self._trust[claim.sender] = min(1.0, 0.5 * adjusted(values) / self.level)
        known = reception.senders
        self._trust = {name: self._trust.get(name, 1.0) for name in known}
        return Trust(dict(self._trust))

    def _match_loss(self, own: Detections, found: Detections) -> float:
        """Return the cost of the best matching of two sets of boxes near the receiver, per box."""
        one, other = (each[np.hypot(*each.boxes.center[:, :2].T) <= self.near_m] for each in (own, found))
        if not len(one) and not len(other):
            return 0.0
        overlap = iou_bev(one.boxes.array, other.boxes.array)
        rows, columns = hungarian(overlap, 1e-6)
        cost = float((1 - overlap[rows, columns]).sum()) + len(one) + len(other) - 2 * len(rows)
        return cost / (len(one) + len(other) - len(rows))

    def _own_basis(self, reception: Reception) -> tuple[Floats, Floats, float] | None:
        """Return mean (D,), principal components (K, D) and loss of patches of the receiver's own map."""
        content = reception.own_features()
        patches = None if content is None else _patches(content)
        if patches is None:
            return None
        mean = patches.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov(patches.T))
        kept = vectors[:, ::-1].T[: self.components]
        return mean, kept, _residual(patches, mean, kept)

    def _reconstruction(self, content: FeatureMap, basis: tuple[Floats, Floats, float] | None) -> float | None:
        """Return the loss of a received map, divided by that of the own map; None: too little of it came."""
        patches = _patches(content)
        if basis is None or patches is None:
            return None
        mean, kept, own_loss = basis
        return _residual(patches, mean, kept) / max(own_loss, 1e-9)


def p_value(loss: float, honest: Floats) -> float:
    """Return the conformal p-value of a loss: the share of honest losses at least as large, itself included."""
    return (1 + int((honest >= loss).sum())) / (1 + len(honest))


def adjusted(values: Sequence[float]) -> float:
    """Return the smallest p-value as Benjamini and Hochberg adjust it: at most `level` if any test rejects at that."""
    ranked = sorted(values)
    return min(1.0, *(value * len(ranked) / (rank + 1) for rank, value in enumerate(ranked)))


def _patches(content: FeatureMap) -> Floats | None:
    """Return patches (P, D) of a map whose cells all came, of those that hold something; None: there are too few."""
    values = content.values.astype(np.float64)
    sent = np.ones(values.shape[1:], np.bool_) if content.sent is None else content.sent
    known: Mask = np.asarray(np.lib.stride_tricks.sliding_window_view(sent, (_PATCH, _PATCH)).all(axis=(2, 3)))
    if content.confidence is not None:
        middle = content.confidence[1:-1, 1:-1]
        surest = np.sort(middle[known])[-_MOST_PATCHES:]
        known &= middle >= (float(surest[0]) if len(surest) else 0.0)
    rows, columns = np.nonzero(known)
    if len(rows) < _FEWEST:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(values, (_PATCH, _PATCH), axis=(1, 2))
    return windows[:, rows, columns].transpose(1, 0, 2, 3).reshape(len(rows), -1)


_MOST_PATCHES = 2000
"""Most patches of a map that are looked at, the surest ones: attacks work where something is found."""


def _residual(patches: Floats, mean: Floats, kept: Floats) -> float:
    """Return the share of the patches' variance that components leave out."""
    centered = patches - mean
    left = centered - centered @ kept.T @ kept
    return float((left**2).sum() / max((centered**2).sum(), 1e-12))
