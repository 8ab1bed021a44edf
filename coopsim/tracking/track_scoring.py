"""Scores of tracks, from the scores of their detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import expit

from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_positive, require_probability
from coopsim.tracking.tracked import Tracked
from coopsim.types import Ints


class Scoring(Protocol):
    """A rule that updates the scores of all tracks at once."""

    def first(self, detected: Floats) -> Floats:
        """Return the scores (K,) of tracks begun by detections with these scores."""

    def hit(self, before: Floats, detected: Floats, age: Ints) -> Floats:
        """Return the scores (K,) of tracks with a detection in this frame; `age` is their frames since birth."""

    def miss(self, before: Floats, age: Ints) -> Floats:
        """Return the scores (K,) of tracks without a detection in this frame."""

    def confidence(self, tracks: Tracked) -> Floats:
        """Return the reported scores (N,)."""


class Latest:
    """The score of the last detection, as in AB3DMOT."""

    def first(self, detected: Floats) -> Floats:
        return detected

    def hit(self, before: Floats, detected: Floats, age: Ints) -> Floats:
        return detected

    def miss(self, before: Floats, age: Ints) -> Floats:
        return before

    def confidence(self, tracks: Tracked) -> Floats:
        return tracks.score


@dataclass(frozen=True, slots=True)
class DecayingScore(Latest):
    """The score of the last detection, times `decay` for each frame without one.

    A track that was sure becomes doubtful while nothing is seen of it.

    Attributes:
        decay: factor per frame without a detection, in [0, 1]; 1: the score stays, as with `Latest`.
    """

    decay: float = 0.9

    def __post_init__(self) -> None:
        require_probability(decay=self.decay)

    def miss(self, before: Floats, age: Ints) -> Floats:
        return before * self.decay


@dataclass(frozen=True, slots=True)
class ShrunkMean:
    """The mean over a track's life, a frame without a detection counting 0, shrunk to a prior while it is young.

    An object that is detected again and again is more likely there than one detected once, however clearly.

    Attributes:
        prior: mean that a track starts from, in [0, 1].
        weight: number of frames that the prior counts for.
    """

    prior: float = 0.2
    weight: float = 10.0

    def __post_init__(self) -> None:
        require_probability(prior=self.prior)
        require_positive(weight=self.weight)

    def first(self, detected: Floats) -> Floats:
        return (self.weight * self.prior + detected) / (self.weight + 1)

    def hit(self, before: Floats, detected: Floats, age: Ints) -> Floats:
        return (before * (self.weight + age) + detected) / (self.weight + age + 1)

    def miss(self, before: Floats, age: Ints) -> Floats:
        kept: Floats = before * (self.weight + age) / (self.weight + age + 1)
        return kept

    def confidence(self, tracks: Tracked) -> Floats:
        return tracks.score


@dataclass(frozen=True, slots=True)
class Likelihood(ShrunkMean):
    """Probability that a track is on an object: log odds linear in its shrunk mean score and this frame's score.

    Attributes:
        bias: log odds with everything else 0.
        mean: per unit of the shrunk mean score.
        latest: per unit of the score of this frame's detection, 0 without one.
        young: per unit of one over the number of its detections: the first few tell more than all later ones.
        missed: added without a detection in this frame.
    """

    bias: float = 0.0
    mean: float = 1.0
    latest: float = 0.0
    young: float = 0.0
    missed: float = 0.0

    def confidence(self, tracks: Tracked) -> Floats:
        weights = np.array([self.mean, self.latest, self.young, self.missed])
        probability: Floats = expit(self.bias + self.features(tracks) @ weights)
        return probability

    @staticmethod
    def features(tracks: Tracked) -> Floats:
        """Return the features (N, 4) of the weights after the bias."""
        missed = tracks.misses > 0
        return np.stack([tracks.score, np.where(missed, 0.0, tracks.latest), 1 / tracks.hits, missed], axis=1)
