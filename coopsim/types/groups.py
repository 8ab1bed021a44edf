"""Groups of detections, one per agent, with their columns joined: for whole-array work on all of them at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import cast, overload

import numpy as np

from coopsim.geometry.se3 import SE3Batch
from coopsim.types.estimates import Detections
from coopsim.types.units import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class DetectionGroups(Sequence[Detections]):
    """Sequence of G groups of detections, stored end to end.

    A fusion that wants arrays takes `joined` and `starts`; any other takes the groups one after another, each of which
    is cut out when it is asked for.

    Attributes:
        joined: the detections (N) of all groups in order, as `Detections.concatenate` joins them.
        starts: (G + 1,) group g is rows starts[g] to starts[g + 1] - 1 of `joined`.
        parts: the groups as they are, where `joined` lacks a column that some of them have, or has one that others
            lack; None: every group is a part of `joined`.
    """

    joined: Detections
    starts: Ints
    parts: tuple[Detections, ...] | None = None
    _group: Ints | None = field(default=None, init=False, repr=False)

    @classmethod
    def of(cls, groups: Iterable[Detections]) -> DetectionGroups:
        """Join groups; what is joined already is returned as it is."""
        if isinstance(groups, DetectionGroups):
            return groups
        parts = tuple(groups)
        starts = np.array([0, *accumulate(len(part.score) for part in parts)])
        return cls(Detections.concatenate(parts), starts, None if are_alike(parts) else parts)

    @property
    def group(self) -> Ints:
        """The number (N,) of the group of each row of `joined`."""
        if self._group is None:
            object.__setattr__(self, "_group", np.repeat(np.arange(len(self)), np.diff(self.starts)))
        return cast(Ints, self._group)

    def __len__(self) -> int:
        return len(self.starts) - 1

    @overload
    def __getitem__(self, index: int) -> Detections: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Detections]: ...

    def __getitem__(self, index: int | slice) -> Detections | Sequence[Detections]:
        if isinstance(index, slice):
            return self.take(range(len(self))[index])
        number = range(len(self))[index]
        if self.parts is not None:
            return self.parts[number]
        return self.joined[self.starts[number] : self.starts[number + 1]]

    def transform_each(self, transforms: SE3Batch) -> DetectionGroups:
        """Move each group by its own transform."""
        joined, parts = self.joined.transform_each(transforms, self.group), self.parts
        if parts is not None:
            parts = tuple(part.transform(transforms[number]) for number, part in enumerate(parts))
        return DetectionGroups(joined, self.starts, parts)

    def keep(self, mask: Mask) -> DetectionGroups:
        """Return the groups without the rows of `joined` that are not in the mask (N,)."""
        if mask.all():
            return self
        parts = self.parts
        if parts is not None:
            bounds = zip(self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True)
            return DetectionGroups.of(part[mask[first:last]] for part, (first, last) in zip(parts, bounds, strict=True))
        return DetectionGroups(self.joined[mask], np.concatenate([[0], np.cumsum(mask)])[self.starts])

    def take(self, numbers: Sequence[int]) -> DetectionGroups:
        """Return the groups of these numbers, in their order."""
        if list(numbers) == list(range(len(self))):
            return self
        if self.parts is not None:
            return DetectionGroups.of(self.parts[number] for number in numbers)
        first, last = self.starts[:-1][list(numbers)], self.starts[1:][list(numbers)]
        starts = np.concatenate([[0], np.cumsum(last - first)])
        rows = np.arange(starts[-1]) + np.repeat(first - starts[:-1], last - first)
        return DetectionGroups(self.joined[rows], starts)


def are_alike(parts: Iterable[Detections]) -> bool:
    """Return whether all parts with detections have the same columns, and none has `seen_by`, so that no part of their
    concatenation gains or lacks anything. Velocities do not count: a part without them gains unknown ones.
    """
    full = [part for part in parts if len(part.score)]
    kinds = {(part.covariance is None, None if part.embedding is None else part.embedding.shape[1]) for part in full}
    return len(kinds) <= 1 and all(part.seen_by is None for part in full)
