"""The seam for metrics: a registered metric is in every score, table and report, and in what a benchmark stores."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from coopsim.metrics.clear import RecallSweep
from coopsim.metrics.log_pool import LogPool
from coopsim.support.registry import Registry

PRIMARY_METRIC = "sAMOTA"
"""The metric that ranks, and that tables, figures and comparisons begin with, unless another is asked for.

It needs no threshold of confidence to be chosen, as MOTA does; a perfect tracker has 100 and a useless one 0, where
AMOTA ends at 51 and has no lower end; and it is the metric that AB3DMOT's authors propose to rank by.
"""


class Metric(ABC):
    """A number of a score, computed from a policy's reports and the ground truth.

    A subclass sets the attributes, defines `value`, and is registered by the name that users read::

        @METRICS.register("track_length")
        class TrackLength(Metric):
            meaning, unit = "mean number of frames of a track", "frames"

            def value(self, pool: LogPool) -> float | None:
                counts = [np.unique(log.track_id, return_counts=True)[1] for log in pool.logs]
                return float(np.concatenate(counts).mean()) if pool.tracks else None

    Attributes:
        meaning: description of the value in one line, for reports.
        unit: unit of the value, such as "%", "m" or "frames"; "" for a count.
        form: format of the value in tables, as `format` takes it.
        less_is_better: True if smaller values are better.
        whole_only: compute the value for a whole score only, not for its classes, superclasses and bands of distance.
        yes_no: True if the value of one episode is 100 for yes and 0 for no, so that its mean is a rate, and statistics
            are those of rates.
        recorders: names of the recorders that keep what the metric reads in `pool.records`, see
            `coopsim.episode.RECORDERS`; the tracks of `pool.logs` need none.
    """

    meaning: str = ""
    unit: str = "%"
    form: str = ".1f"
    less_is_better: bool = False
    whole_only: bool = False
    yes_no: bool = False
    recorders: tuple[str, ...] = ()

    @property
    def definition(self) -> str:
        """The meaning with the unit, for reports."""
        return f"{self.meaning}, in {self.unit}" if self.unit else self.meaning

    @abstractmethod
    def value(self, pool: LogPool) -> float | None:
        """Compute the value for one agent's logs, pooled over sequences.

        Args:
            pool: the logs, which must not be changed, and intermediate results that several metrics share.

        Returns:
            A number, or None where these logs do not have the metric. NaN means undefined: a dash in tables, and left
            out of means.
        """


@dataclass(frozen=True)
class PoolMetric(Metric):
    """A metric that a function computes from the pool; None where a recorder of it kept nothing."""

    of: Callable[[LogPool], float | None]
    meaning: str
    unit: str = "%"
    form: str = ".1f"
    less_is_better: bool = False
    whole_only: bool = False
    yes_no: bool = False
    recorders: tuple[str, ...] = ()

    def value(self, pool: LogPool) -> float | None:
        return self.of(pool) if all(pool.records[name] for name in self.recorders) else None


class SweepMetric(Metric):
    """A metric of CLEAR's counts over levels of recall, which can be computed without false positives."""

    def value(self, pool: LogPool) -> float | None:
        return self.of_sweep(pool.sweep)

    @abstractmethod
    def of_sweep(self, sweep: RecallSweep) -> float:
        """Compute the value from CLEAR's counts at every level of recall."""


def mean_of_known(values: Iterable[float]) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    every = np.array(list(values), dtype=np.float64)
    known = every[~np.isnan(every)]
    return float(known.mean()) if len(known) else math.nan


METRICS: Registry[type[Metric] | Metric] = Registry("metric", home="coopsim.metrics.built_in", group="coopsim.metrics")
"""Metric classes (or objects) by name; an installed package adds its own by the entry-point group `coopsim.metrics`."""
