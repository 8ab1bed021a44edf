"""Lifecycles: which tracks are reported, and which are dropped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count, require_non_negative
from coopsim.tracking.tracked import Tracked
from coopsim.types import Mask


class Lifecycle(Protocol):
    """A rule that reports and drops tracks, N at once."""

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        """Return which tracks to report (N,); `frame` is the number of this frame, from 1."""

    def alive(self, tracks: Tracked) -> Mask:
        """Return which tracks to keep (N,)."""


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

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        return _confirmed(tracks, frame, self.hits, self.age if self.coast is None else self.coast)

    def alive(self, tracks: Tracked) -> Mask:
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

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        return (tracks.confidence >= self.report) & (tracks.misses <= self.coast)

    def alive(self, tracks: Tracked) -> Mask:
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

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        if self.coast is None:
            return _confirmed(tracks, frame, self.hits, np.inf) & self.alive(tracks)
        return _confirmed(tracks, frame, self.hits, self.coast)

    def alive(self, tracks: Tracked) -> Mask:
        speed_m_s = np.linalg.norm(tracks.velocity, axis=1)
        alive: Mask = tracks.misses < self.age + self.age_per_m_s * speed_m_s
        return alive


@dataclass(frozen=True, slots=True)
class Remembered:
    """Another rule that also keeps, unreported, confirmed tracks that it would drop, while their looks are remembered.

    For how long they are, the tracker's appearance says (`Appearance.window_s`). Boxes of such tracks mean little: a
    stage that compares boxes selects the tracks `in_sight`, a stage that compares embeddings all.

    Attributes:
        rule: reports and drops the tracks in sight, and all tracks without an embedding.
        hits: frames with a detection from which a track is kept.
    """

    rule: Lifecycle
    hits: int = 3

    def __post_init__(self) -> None:
        require_count(1, hits=self.hits)

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        return self.rule.reported(tracks, frame) & self.rule.alive(tracks)

    def alive(self, tracks: Tracked) -> Mask:
        return self.rule.alive(tracks) | (tracks.appearance.known & (tracks.hits >= self.hits))

    def in_sight(self, tracks: Tracked) -> Mask:
        """Return which predicted tracks (N,) the other rule would have kept until this frame."""
        before = replace(tracks, misses=tracks.misses - 1)
        return self.rule.alive(before) | ~tracks.appearance.ever_known


def _confirmed(tracks: Tracked, frame: int, hits: int, coast: float) -> Mask:
    return ((tracks.hits >= hits) | (frame <= hits)) & (tracks.misses <= coast)
