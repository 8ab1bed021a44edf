"""The results of a benchmark as arrays: policies by conditions by seeds, with failed and missing cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.grid.cell import CellResult, Condition
from coopsim.bench.results.samples import Samples, samples_of
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES, custom_metrics
from coopsim.metrics.metric import PRIMARY_METRIC

REPORTED = (
    *(PRIMARY_METRIC, "AMOTA", "AMOTP", "MOTA", "MOTP", "HOTA", "DetA", "AssA", "IDF1", "recall", "precision"),
    *("IDS", "FP", "FN", "APBEV@0.5", "mAP3D@0.5", BYTES),
)
"""The built-in metrics that reports show, in order; those that users have registered follow."""


@dataclass(frozen=True, slots=True, eq=False)
class ResultTable:
    """The results of a benchmark, sorted.

    Attributes:
        policies: P, sorted.
        conditions: C, sorted.
        seeds: S, sorted.
        metrics: names of all values in the results: `REPORTED`, then registered metrics, then the others.
        frames: length of each run.
        results: the results themselves, by cell.
        places: place of each result in the arrays.
        samples: what the seeds are samples of.
    """

    policies: tuple[str, ...]
    conditions: tuple[Condition, ...]
    seeds: tuple[int, ...]
    metrics: tuple[str, ...]
    frames: int
    results: tuple[CellResult, ...]
    places: tuple[tuple[int, int, int], ...]
    samples: Samples

    @property
    def arithmetics(self) -> tuple[str, ...]:
        """Arithmetics of networks in the results, as far as they are known."""
        return tuple(sorted({result.arithmetic for result in self.results} - {""}))

    @property
    def caution(self) -> str:
        """Warning where networks multiplied in several arithmetics; empty where in one."""
        several = " and ".join(self.arithmetics) if len(self.arithmetics) > 1 else ""
        return several and f"Networks multiplied in {several}: differences between cells may come from that."

    @classmethod
    def of(cls, results: Sequence[CellResult]) -> ResultTable:
        """Sort results into a table.

        Raises:
            InvalidValueError: there are no results, runs have several lengths, or a cell is there twice.
        """
        if not results:
            raise InvalidValueError("there are no results: run a benchmark first")
        ordered = tuple(sorted(results, key=lambda result: result.cell))
        lengths = sorted({result.cell.frames for result in ordered})
        if len(lengths) > 1:
            raise InvalidValueError(f"results must be of runs of one length, got {lengths} frames")
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
            lengths[0],
            ordered,
            tuple((policies[cell.policy], conditions[cell.condition], seeds[cell.seed]) for cell in cells),
            samples_of(ordered, tuple(seeds)),
        )

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Mask (P, C, S) of the cells that were run and did not fail."""
        finished: NDArray[np.bool_] = self._filled([float(not result.failed) for result in self.results]) == 1
        return finished

    def values(self, metric: str) -> Floats:
        """Return the values (P, C, S) of a metric; NaN where a cell failed, is missing, or has no finite value.

        Raises:
            UnknownNameError: no cell has it.
        """
        if metric not in self.metrics:
            raise UnknownNameError("metric", metric, self.metrics)
        values = self._filled([result.values.get(metric, np.nan) for result in self.results])
        values[np.isinf(values)] = np.nan  # a mean could not include it
        return values

    def whole(self, metric: str, conditions: Sequence[int] | None = None) -> NDArray[np.bool_]:
        """Return the mask (P,) of policies that can be compared: each cell finished, with a value where any policy has.

        A cell in which nobody has a value, as of a run without objects, is left out for all alike.

        Args:
            metric: its name.
            conditions: their numbers; None: all.

        Raises:
            UnknownNameError: no cell has it.
        """
        chosen = slice(None) if conditions is None else list(conditions)
        known, finished = ~np.isnan(self.values(metric)[:, chosen]), self.finished[:, chosen]
        whole: NDArray[np.bool_] = np.all(finished & (known | ~known.any(axis=0)), axis=(1, 2))
        any_value: NDArray[np.bool_] = np.any(known, axis=(1, 2))
        return whole & any_value

    @property
    def shown(self) -> tuple[str, ...]:
        """The metrics that reports show, without bytes per second; all in the results if these have no usual one."""
        usual = {*REPORTED, *custom_metrics()} - {BYTES}
        known = [name for name in self.metrics if name in usual]
        return tuple(known) or tuple(name for name in self.metrics if name != BYTES)

    @property
    def failures(self) -> tuple[CellResult, ...]:
        """The results of failed cells."""
        return tuple(result for result in self.results if result.failed)

    @property
    def counted(self) -> dict[str, str]:
        """What policies counted in all their cells, in words, by policy; those that counted nothing are left out."""
        total: dict[str, Counter[str]] = {policy: Counter() for policy in self.policies}
        for result in self.results:
            total[result.cell.policy].update(result.counts)
        words = {policy: ", ".join(f"{n} {name}" for name, n in sorted(each.items())) for policy, each in total.items()}
        return {policy: text for policy, text in words.items() if text}

    @property
    def methods(self) -> dict[str, str]:
        """Which method of a paper, or part of one, each policy is; policies that do not say are left out."""
        return {result.cell.policy: result.method for result in self.results if result.method}

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
        for place, number in zip(self.places, numbers, strict=True):
            filled[place] = number
        return filled
