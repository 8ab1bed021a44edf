"""What the values of a benchmark are samples of: seeds, or drawn places, which several seeds may share."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.bench.grid.cell import CellResult
from coopsim.bench.results.statistics import Interval, mean_interval
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The independent samples of a benchmark, over which its intervals are.

    Runs in the same place are alike, so where places are drawn a place is one sample, of the mean of its seeds. Where
    all runs are in one place, seeds are the samples, and nothing is known of other places.

    Attributes:
        group: (S,) number of the sample that each seed belongs to, from 0.
        are_places: whether every scenario draws places, so that a sample is a place.
        in_one_place: whether all runs are in one drawn place.
        places: number of different drawn places of all runs.
    """

    group: Ints
    are_places: bool = False
    in_one_place: bool = False
    places: int = 0

    @property
    def count(self) -> int:
        """The number of samples."""
        return int(self.group.max(initial=-1)) + 1

    @property
    def kind(self) -> str:
        """What the samples are: "seeds", "places", or "samples": groups of seeds, of which some share a place."""
        if self.are_places and self.places <= self.count:
            return "places"
        return "seeds" if self.count == len(self.group) else "samples"

    @property
    def text(self) -> str:
        """The samples in words, as "5 seeds", "one place", "5 seeds in one place" or "5 seeds, 10 places"."""
        return self.counted(self.count) + f", {self.places} places" * (self.places > self.count)

    def counted(self, count: int) -> str:
        """Describe some of the samples in words, as `text` does all."""
        kind = self.kind[: -1 if count == 1 else None]
        return f"{'one' if count == 1 else count} {kind}{' in one place' * self.in_one_place}"

    def average(self, values: Floats) -> Floats:
        """Return the means (..., N) over the seeds of each sample of values (..., S); NaNs are left out."""
        if self.count == len(self.group):
            return values
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of means without values
            means = [np.nanmean(values[..., self.group == k], axis=-1) for k in range(self.count)]
        return np.stack(means, axis=-1)

    def interval(self, values: Floats) -> Interval:
        """Return the mean of values (S,) by seed with its interval over samples."""
        return mean_interval(self.average(values))


def samples_of(results: Iterable[CellResult], seeds: Sequence[int]) -> Samples:
    """Find the samples among results.

    Args:
        results: of cells; failed ones tell nothing.
        seeds: S, all that the results have.
    """
    drawn: dict[str, dict[int, int | None]] = defaultdict(dict)
    for result in results:
        if not result.failed:
            drawn[result.cell.condition.scenario][result.cell.seed] = result.place_seed
    places = len({place for each in drawn.values() for place in each.values()} - {None})
    several = [each for each in drawn.values() if len(set(each.values()) - {None}) > 1]
    one = [each for each in drawn.values() if len(set(each.values()) - {None}) == 1]
    if not several:
        alone = len(one) == len(drawn) == 1
        return Samples(np.arange(len(seeds)), alone and len(seeds) == 1, alone and len(seeds) > 1, places)
    group = {seed: k for k, seed in enumerate(seeds)}
    for each in several:
        _join(group, each)
    numbers = {each: k for k, each in enumerate(dict.fromkeys(group[seed] for seed in seeds))}
    return Samples(np.array([numbers[group[seed]] for seed in seeds]), len(several) == len(drawn), places=places)


def _join(group: dict[int, int], places: dict[int, int | None]) -> None:
    """Put seeds that have a place in common into one group."""
    first: dict[int, int] = {}
    for seed, place in places.items():
        if place is None:
            continue
        other, own = first.setdefault(place, group[seed]), group[seed]
        if other != own:
            for each in group:
                if group[each] == own:
                    group[each] = other
