"""The results of a benchmark as arrays: policies by conditions by seeds, with failed and missing cells."""

from __future__ import annotations

import warnings
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.grid.cell import CellResult, Condition, columns_of, further_options
from coopsim.bench.results.statistics import Interval, mean_interval, rate_interval
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES, custom_metrics, is_yes_no
from coopsim.metrics.deception import DECEPTION
from coopsim.metrics.driving import DRIVING
from coopsim.metrics.finding import FINDING
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.types import Ints

REPORTED = (
    *(PRIMARY_METRIC, "AMOTA", "AMOTP", "MOTA", "MOTP", "HOTA", "DetA", "AssA", "IDF1", "recall", "precision"),
    *("IDS", "FP", "FN", "APBEV@0.5", "mAP3D@0.5", *DRIVING, *DECEPTION, *FINDING, BYTES),
)
"""The built-in metrics that reports show, in order; those that users have registered follow."""


_FIRST = ("crash",)
"""Metrics that rank wherever the results have them: a tracker's score is no answer where a car is driven."""


_COUNTED = {
    "passes of the defense": "further passes of the policy for its defence",
    "receptions judged": "received messages judged by the defence",
}
"""Words of counters for readers."""


def named(policy: str, *, bound: bool) -> str:
    """Return a policy's name as tables show it: a bound is marked."""
    return f"{policy} (upper bound)" if bound else policy


@dataclass(frozen=True, slots=True, eq=False)
class ResultTable:
    """The results of a benchmark, sorted.

    Attributes:
        policies: P, sorted.
        conditions: C, sorted.
        seeds: S, sorted.
        metrics: names of all values in the results: `REPORTED`, then registered metrics, then the others.
        frames: length of each run; None: each ended with its episode.
        places: place of each result in the arrays.
        samples: independent samples that the seeds make.
        asked: metrics that reports begin with; the first one ranks.
        bounds: policies that were told the truth: upper bounds, which stand in every table and do not compete.
    """

    policies: tuple[str, ...]
    conditions: tuple[Condition, ...]
    seeds: tuple[int, ...]
    metrics: tuple[str, ...]
    frames: int | None
    results: tuple[CellResult, ...]
    places: tuple[tuple[int, int, int], ...]
    samples: Samples
    asked: tuple[str, ...] = ()
    bounds: frozenset[str] = frozenset()
    _known: dict[str, Floats] = field(default_factory=dict, repr=False)  # values that were asked for before

    @property
    def arithmetics(self) -> tuple[str, ...]:
        """Arithmetics of networks in the results, as far as they are known."""
        return tuple(sorted({result.arithmetic for result in self.results} - {""}))

    @property
    def caution(self) -> str:
        """Warning where networks multiplied in several arithmetics; empty where in one."""
        several = " and ".join(self.arithmetics) if len(self.arithmetics) > 1 else ""
        return several and f"Networks multiplied in {several}: differences between runs may come from that."

    @classmethod
    def of(cls, results: Sequence[CellResult], asked: Sequence[str] = ()) -> ResultTable:
        """Sort results into a table; reports begin with the metrics that are `asked` for.

        Raises:
            InvalidValueError: there are no results, runs have several lengths, or a cell is there twice.
        """
        if not results:
            raise InvalidValueError("there are no results: run a benchmark first")
        lengths = {result.cell.frames for result in results}
        if len(lengths) > 1:
            shown = sorted(lengths, key=lambda length: length or 0)
            raise InvalidValueError(f"results must be of runs of one length, got {shown} frames")
        ordered = tuple(sorted(results, key=lambda result: result.cell))
        cells = [result.cell for result in ordered]
        twice = next((cell for cell, after in pairwise(cells) if cell == after), None)
        if twice is not None:
            raise InvalidValueError(f"each cell must be there once, got two of {twice}")
        names = {name for result in ordered for name in result.values}
        known = [name for name in (*REPORTED, *custom_metrics()) if name in names]
        policies = {name: k for k, name in enumerate(sorted({cell.policy for cell in cells}))}
        conditions = {each: k for k, each in enumerate(sorted({cell.condition for cell in cells}))}
        seeds = {seed: k for k, seed in enumerate(sorted({cell.seed for cell in cells}))}
        return cls(
            tuple(policies),
            tuple(conditions),
            tuple(seeds),
            (*known, *sorted(names.difference(known))),
            next(iter(lengths)),
            ordered,
            tuple((policies[cell.policy], conditions[cell.condition], seeds[cell.seed]) for cell in cells),
            samples_of(ordered, tuple(seeds)),
            tuple(asked),
            frozenset(result.cell.policy for result in ordered if result.bound),
        )

    def columns(self, condition: Condition | None) -> dict[str, Any]:
        """Return a condition's columns, the same for all conditions; their values are None for none."""
        return columns_of(condition, further_options(self.conditions))

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Mask (P, C, S) of the cells that were run and did not fail."""
        finished: NDArray[np.bool_] = self._filled([float(not result.failed) for result in self.results]) == 1
        return finished

    def values(self, metric: str) -> Floats:
        """Return the values (P, C, S) of a metric, to read; NaN where a run failed, lacks, or has no finite value."""
        if metric not in self.metrics:
            raise UnknownNameError("metric", metric, self.metrics)
        if metric not in self._known:
            values = self._filled([result.values.get(metric, np.nan) for result in self.results])
            values[np.isinf(values)] = np.nan  # a mean could not include it
            values.setflags(write=False)
            self._known[metric] = values
        return self._known[metric]

    def whole(self, metric: str, conditions: Sequence[int] | None = None) -> NDArray[np.bool_]:
        """Return the mask (P,) of policies that can be compared: each cell finished, with a value where any policy has.

        A cell in which no policy has a value, as of a run without objects, is left out for all alike. `conditions` are
        their numbers; None: all.
        """
        chosen = slice(None) if conditions is None else list(conditions)
        known, finished = ~np.isnan(self.values(metric)[:, chosen]), self.finished[:, chosen]
        whole: NDArray[np.bool_] = np.all(finished & (known | ~known.any(axis=0)), axis=(1, 2))
        any_value: NDArray[np.bool_] = np.any(known, axis=(1, 2))
        return whole & any_value

    def interval(self, metric: str, values: Floats) -> Interval:
        """Return the mean of a metric's values (S,) by seed with its interval over samples: Wilson's for yes or no."""
        averages = self.samples.average(values)
        return rate_interval(averages) if is_yes_no(metric) else mean_interval(averages)

    def mean(self, metric: str, policy: int, conditions: Sequence[int]) -> Interval:
        """Return the mean of a metric of a policy over conditions, with its interval.

        A run in another scenario is another sample of a rate, as it is another episode; runs in one scenario with one
        seed are alike, whatever disturbs them, and count once. So a rate has the same interval in every table. Other
        metrics differ from scenario to scenario more than by chance: their samples are seeds, over all conditions.
        """
        values = self.values(metric)[policy]
        if not is_yes_no(metric):
            return self.interval(metric, known_mean(values[list(conditions)], axis=0))
        groups = [[k for k in conditions if self.conditions[k].scenario == name] for name in self.scenarios]
        rows = [self.samples.average(known_mean(values[group], axis=0)) for group in groups if group]
        return rate_interval(np.concatenate(rows)) if rows else rate_interval(np.zeros(0))

    @property
    def shown(self) -> tuple[str, ...]:
        """The metrics that reports show, without bytes per second; all in the results if these have no usual one.

        The first one ranks: the first that was asked for, else crashes where cars were driven.
        """
        first = [name for name in self.asked or _FIRST if name in self.metrics]
        usual = {*REPORTED, *custom_metrics()}
        known = [name for name in self.metrics if name in usual and name != BYTES] or self.metrics
        return tuple(name for name in dict.fromkeys([*first, *known]) if name != BYTES)

    @property
    def failures(self) -> tuple[CellResult, ...]:
        """The results of failed cells."""
        return tuple(result for result in self.results if result.failed)

    @property
    def counted(self) -> dict[str, str]:
        """The counters of policies over all their cells, in words, by policy; policies without any are left out."""
        total: dict[str, Counter[str]] = {policy: Counter() for policy in self.policies}
        for result in self.results:
            total[result.cell.policy].update(result.counts)
        words = {
            policy: ", ".join(f"{n} {_COUNTED.get(name, name)}" for name, n in sorted(each.items()))
            for policy, each in total.items()
        }
        return {policy: text for policy, text in words.items() if text}

    @property
    def methods(self) -> dict[str, str]:
        """The method of a paper that each policy is, or a part of it; policies that do not say are left out."""
        return {result.cell.policy: result.method for result in self.results if result.method}

    @property
    def names(self) -> dict[str, str]:
        """The policies' names as tables show them, by policy: bounds are marked."""
        return {policy: named(policy, bound=policy in self.bounds) for policy in self.policies}

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the scenarios, sorted."""
        return tuple(sorted({condition.scenario for condition in self.conditions}))

    @property
    def missing(self) -> int:
        """Number of cells of the full grid that were not run."""
        return self.finished.size - len(self.results)

    def _filled(self, numbers: Sequence[float]) -> Floats:
        filled = np.full((len(self.policies), len(self.conditions), len(self.seeds)), np.nan)
        filled[tuple(np.array(self.places).T)] = numbers
        return filled


def known_mean(values: Floats, axis: int) -> Floats:
    """Average the values that are not NaN; NaN where all are."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of means without values
        mean: Floats = np.nanmean(values, axis=axis)
    return mean


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The independent samples of a benchmark, over which its intervals are.

    Runs in the same place are alike, so where places are drawn a place is one sample, of the mean of its seeds. Where
    all runs are in one place, seeds are the samples, and nothing is known of other places.

    Attributes:
        group: (S,) number of the sample that each seed belongs to, from 0.
        are_places: True if every scenario draws places, so that a sample is a place.
        in_one_place: True if all runs are in one drawn place.
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
        """The kind of the samples: "seeds", "places", or "samples": groups of seeds, of which some share a place."""
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
        means = [known_mean(values[..., self.group == k], axis=-1) for k in range(self.count)]
        return np.stack(means, axis=-1)


def samples_of(results: Iterable[CellResult], seeds: Sequence[int]) -> Samples:
    """Find the samples among results for all `seeds` (S) that they have; failed cells tell nothing."""
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
