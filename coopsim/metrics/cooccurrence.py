"""Co-occurrence of objects and tracks in a sequence, in frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.metrics.matching import NumberedSequence, frame_of
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Cooccurrence:
    """The C distinct combinations of an object and a track among the P candidate pairs of a sequence.

    C is far smaller than the number of objects times the number of tracks.

    Attributes:
        object: (C,) number of the object.
        track: (C,) number of the track.
        frames: (C,) frames of the object plus frames of the track.
        of_pair: (P,) the combination of each pair.
        truth_row: (P,) row of each pair's truth box in the sequence.
        track_row: (P,) row of each pair's reported box in the sequence.
    """

    object: Ints
    track: Ints
    frames: Ints
    of_pair: Ints
    truth_row: Ints
    track_row: Ints

    @classmethod
    def of(cls, sequence: NumberedSequence) -> Cooccurrence:
        """Find the combinations of a sequence."""
        data, tracks = sequence.arrays, max(len(sequence.mean_score), 1)
        frame = frame_of(data.pair_start)
        truth_row, track_row = data.truth_start[frame] + data.pair_truth, data.track_start[frame] + data.pair_track
        key, of_pair = np.unique(data.truth[truth_row] * tracks + data.track[track_row], return_inverse=True)
        object_, track = np.divmod(key, tracks)
        frames = np.bincount(data.truth, minlength=1)[object_] + np.bincount(data.track, minlength=1)[track]
        return cls(object_, track, frames, of_pair, truth_row, track_row)

    def __len__(self) -> int:
        return len(self.object)
