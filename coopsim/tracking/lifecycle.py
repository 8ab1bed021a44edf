"""Scores and lifecycles of tracks: how sure a track is, when it is reported, and when it is dropped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.special import expit

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count, require_non_negative, require_positive, require_probability
from coopsim.tracking.track_states import TrackStates
from coopsim.types import Ints, Mask


class Lifecycle(Protocol):
    """A rule that reports and drops tracks, N at once."""

    def reported(self, tracks: TrackStates, frame: int) -> Mask:
        """Return the mask (N,) of tracks to report; `frame` is the number of this frame, from 1.

        Our own rules also take a number for each track (N,), of trackers with different numbers of frames.
        """

    def alive(self, tracks: TrackStates) -> Mask:
        """Return the mask (N,) of tracks to keep."""


@dataclass(frozen=True, slots=True)
class HitsAndAge:
    """AB3DMOT's rule (Weng et al. 2020, sec. III-E): confirmed by hits, dropped by age.

    In the first `hits` frames every track is reported, because none can be confirmed yet. As in AB3DMOT's code a track
    is confirmed by its number of hits so far, consecutive or not.

    Attributes:
        hits: frames with a detection until a track is reported.
        age: frames without a detection until it is dropped.
        coast: frames without a detection for which its prediction is still reported; None: until it is dropped.
    """

    hits: int = 3
    age: int = 2
    coast: int | None = None

    def __post_init__(self) -> None:
        require_count(1, hits=self.hits, age=self.age)
        require_count(0, coast=self.age if self.coast is None else self.coast)

    def reported(self, tracks: TrackStates, frame: int | Ints) -> Mask:
        return _confirmed(tracks, frame, self.hits, self.age if self.coast is None else self.coast)

    def alive(self, tracks: TrackStates) -> Mask:
        return tracks.misses < self.age


@dataclass(frozen=True, slots=True)
class ByScore:
    """Reported from a confidence on; dropped below a score, or after `age` frames without a detection.

    Attributes:
        report: smallest confidence of a reported track; the confidence is the score unless the scoring has a better
            one.
        drop: a track with a smaller score is dropped.
        age: frames without a detection until a track is dropped.
        coast: frames without a detection for which a track is still reported.
    """

    report: float
    drop: float = -np.inf
    age: int = 2
    coast: int = 1

    def __post_init__(self) -> None:
        require_count(1, age=self.age)
        require_count(0, coast=self.coast)
        if np.isnan(self.report) or np.isnan(self.drop):
            raise InvalidValueError(f"report and drop must be numbers, got {self.report!r} and {self.drop!r}")

    def reported(self, tracks: TrackStates, frame: int | Ints) -> Mask:
        return (tracks.confidence >= self.report) & (tracks.misses <= self.coast)

    def alive(self, tracks: TrackStates) -> Mask:
        return (tracks.misses < self.age) & (tracks.score >= self.drop)


@dataclass(frozen=True, slots=True)
class VelocityAdaptiveAge:
    """Confirmed by hits; the faster an object, the longer its track is kept (DINO-CoDT, He et al., eq. 10).

    The maximum age is `age + age_per_m_s * speed`: a fast object soon comes out from behind what hides it.

    Attributes:
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until the track of a standing object is dropped (the paper's A_c).
        age_per_m_s: frames more per m/s (the paper's alpha), >= 0.
        coast: frames without a detection for which a track is still reported; a track that is kept longer is not
            reported meanwhile. None: reported while it is kept, as AB3DMOT reports.
    """

    hits: int = 3
    age: int = 2
    age_per_m_s: float = 0.2
    coast: int | None = 1

    def __post_init__(self) -> None:
        require_count(1, hits=self.hits, age=self.age)
        require_count(0, coast=0 if self.coast is None else self.coast)
        require_non_negative(age_per_m_s=self.age_per_m_s)

    def reported(self, tracks: TrackStates, frame: int | Ints) -> Mask:
        if self.coast is None:
            return _confirmed(tracks, frame, self.hits, np.inf) & self.alive(tracks)
        return _confirmed(tracks, frame, self.hits, self.coast)

    def alive(self, tracks: TrackStates) -> Mask:
        speed_m_s = np.linalg.norm(tracks.velocity, axis=1)
        alive: Mask = tracks.misses < self.age + self.age_per_m_s * speed_m_s
        return alive


@dataclass(frozen=True, slots=True)
class Remembered:
    """Another rule that also keeps, unreported, confirmed tracks that it would drop, while they have embeddings.

    Embeddings last for `Appearance.window_s`. Boxes of such tracks mean little: a stage that compares boxes selects the
    tracks `in_view`, a stage that compares embeddings all.

    Attributes:
        rule: reports and drops the tracks in view, and all tracks without an embedding.
        hits: frames with a detection from which a track is kept.
    """

    rule: Lifecycle
    hits: int = 3

    def __post_init__(self) -> None:
        require_count(1, hits=self.hits)

    def reported(self, tracks: TrackStates, frame: int) -> Mask:
        return self.rule.reported(tracks, frame) & self.rule.alive(tracks)

    def alive(self, tracks: TrackStates) -> Mask:
        return self.rule.alive(tracks) | (tracks.appearance.known & (tracks.hits >= self.hits))

    def in_view(self, tracks: TrackStates) -> Mask:
        """Return the mask (N,) of predicted tracks that the other rule would have kept until this frame."""
        before = replace(tracks, misses=tracks.misses - 1)
        return self.rule.alive(before) | ~tracks.appearance.ever_known


def _confirmed(tracks: TrackStates, frame: int | Ints, hits: int, coast: float) -> Mask:
    return ((tracks.hits >= hits) | (frame <= hits)) & (tracks.misses <= coast)


class Scoring(Protocol):
    """A rule that updates the scores of all tracks at once."""

    def first(self, detected: Floats) -> Floats:
        """Return the scores (K,) of tracks begun by detections with these scores."""

    def hit(self, before: Floats, detected: Floats, age: Ints) -> Floats:
        """Return the scores (K,) of tracks with a detection in this frame; `age` is their frames since birth."""

    def miss(self, before: Floats, age: Ints) -> Floats:
        """Return the scores (K,) of tracks without a detection in this frame."""

    def confidence(self, tracks: TrackStates) -> Floats:
        """Return the reported scores (N,)."""


class Latest:
    """The score of the last detection, as in AB3DMOT."""

    def first(self, detected: Floats) -> Floats:
        return detected

    def hit(self, before: Floats, detected: Floats, age: Ints) -> Floats:
        return detected

    def miss(self, before: Floats, age: Ints) -> Floats:
        return before

    def confidence(self, tracks: TrackStates) -> Floats:
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

    def confidence(self, tracks: TrackStates) -> Floats:
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

    def confidence(self, tracks: TrackStates) -> Floats:
        weights = np.array([self.mean, self.latest, self.young, self.missed])
        probability: Floats = expit(self.bias + self.features(tracks) @ weights)
        return probability

    @staticmethod
    def features(tracks: TrackStates) -> Floats:
        """Return the features (N, 4) of the weights after the bias."""
        missed = tracks.misses > 0
        return np.stack([tracks.score, np.where(missed, 0.0, tracks.latest), 1 / tracks.hits, missed], axis=1)
