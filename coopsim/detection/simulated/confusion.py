"""Confused classes: the label that a detector reports for an object of some class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from coopsim.detection.simulated.persistence import Persistence, PersistentNormals
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_probability
from coopsim.types import Ints
from coopsim.types.taxonomy import CLASS_NAMES


@dataclass(frozen=True, slots=True)
class ClassConfusion:
    """A confusion matrix, and how long a confusion lasts.

    Attributes:
        shares: by true class, then by reported class: the share of the detections of the first that are reported as the
            second. The rest of each row is reported as what it is.
        persistence: correlation over time of the standard normal number that decides, for one agent and object.
    """

    shares: Mapping[str, Mapping[str, float]]
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        if not (isinstance(self.shares, Mapping) and all(isinstance(row, Mapping) for row in self.shares.values())):
            raise InvalidValueError(f"shares must be a mapping of mappings by class, got {self.shares!r}")
        if not isinstance(self.persistence, Persistence):
            raise InvalidValueError(f"persistence must be a coopsim Persistence, got {self.persistence!r}")
        for true, row in self.shares.items():
            require_choice("class in shares", true, CLASS_NAMES)
            for reported, share in row.items():
                require_choice(f"class in shares of {true}", reported, CLASS_NAMES)
                require_probability(**{f"share of {true} reported as {reported}": share})
            if true in row or sum(row.values()) > 1:
                raise InvalidValueError(f"shares of {true} must be of other classes and at most 1 together, got {row}")

    @property
    def matrix(self) -> Floats:
        """The confusion matrix (9, 9): rows are true classes, columns reported ones; each row sums to 1."""
        matrix = np.zeros((len(CLASS_NAMES), len(CLASS_NAMES)))
        for true, row in self.shares.items():
            for reported, share in row.items():
                matrix[CLASS_NAMES.index(true), CLASS_NAMES.index(reported)] = share
        np.fill_diagonal(matrix, 1.0 - matrix.sum(axis=1))
        return matrix

    @property
    def levels(self) -> Floats:
        """The matrix without its diagonal (9, 9), each row added up from its start: what `confuse` is given."""
        others = self.matrix
        np.fill_diagonal(others, 0.0)
        levels: Floats = np.cumsum(others, axis=1)
        return levels


def confuse(levels: Floats, label: Ints, uniform: Floats) -> Ints:
    """Return the reported labels (N,) for true labels (N,) and draws (N,), uniform in [0, 1]."""
    row = levels[label]
    wrong = uniform < row[:, -1]
    reported: Ints = np.where(wrong, np.argmax(uniform[:, None] < row, axis=1), label)
    return reported


class LabelNoise:
    """Class confusions of agents over one episode; call once per frame, in order.

    Args:
        config: the confusion matrix and its persistence.
        seed: the episode's seed.
        owners: A, each the name of a purpose and an agent that draws are for.
        dt_s: (A,) time between two frames of each owner.
    """

    def __init__(self, config: ClassConfusion, seed: int, owners: Sequence[str], dt_s: Sequence[float]) -> None:
        self._levels = config.levels
        owners = [f"classes, {owner}" for owner in owners]
        self._normals = PersistentNormals(seed, owners, (config.persistence,), dt_s)

    def step(self, asked: Ints, start: Ints, ids: Ints, wanted: Ints, label: Ints) -> Ints:
        """Return the labels (M,) that are reported for the objects `wanted`, whose true labels (M,) are given.

        The other arguments are those of `PersistentNormals.step`.
        """
        return confuse(self._levels, label, ndtr(self._normals.step(asked, start, ids, wanted)[:, 0]))


DEFAULT_CONFUSION = ClassConfusion(
    {
        "car": {"van": 0.02},
        "van": {"car": 0.15, "truck": 0.05},
        "truck": {"van": 0.05, "bus": 0.05},
        "bus": {"truck": 0.1},
        "motorcycle": {"bicycle": 0.1, "scooter": 0.05},
        "bicycle": {"pedestrian": 0.033, "motorcycle": 0.05, "scooter": 0.02},
        "scooter": {"pedestrian": 0.033, "bicycle": 0.05, "motorcycle": 0.05},
        "pedestrian": {"bicycle": 0.038, "child": 0.02},
        "child": {"pedestrian": 0.1, "bicycle": 0.038},
    },
    Persistence(constant=0.4, lasting=0.4, lasting_s=1.0),
)
"""Confusion of the fitted detector.

Measured: people and cyclists taken for each other, and the persistence, by PointRCNN on KITTI's 15 training sequences
with detections (`scripts/measure_confusion.py`): 44 of 1,171 pedestrians were reported as cyclists, 14 of 420 cyclists
as pedestrians; a wrong label is wrong again in the next frame (0.1 s later) with probability 0.48, as a Gaussian copula
with correlation 0.8 gives. Assumed, because no detections here tell these classes apart: all other shares, which are
between classes of neighbouring sizes. The detector's own recordings (V2V4Real) have one class only.
"""
