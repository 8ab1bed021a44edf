"""Means with intervals and significance as CSV, for figures of one's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from coopsim.bench.grid.cell import Condition
from coopsim.bench.report.formats import to_csv_text
from coopsim.bench.results.best import beside_best
from coopsim.bench.results.result_table import ResultTable


def to_csv(table: ResultTable, metrics: Sequence[str]) -> str:
    """Format a row per condition, metric and policy, unrounded; rows without a scenario are over all conditions.

    `low` and `high` are the ends of the 95 % interval of the mean over `samples` seeds or places; empty where they are
    not known. `p_to_best` is the corrected p-value of the difference to the best policy of that condition and metric,
    see `coopsim.bench.results.best`; empty for the best one, and for a policy that is not `complete`.

    Raises:
        UnknownNameError: there is no such metric.
    """
    every = tuple(range(len(table.conditions)))
    groups: list[tuple[Condition | None, tuple[int, ...]]] = [(None, every)] if len(every) > 1 else []
    groups += [(condition, (k,)) for k, condition in enumerate(table.conditions)]
    rows: list[dict[str, Any]] = []
    for condition, numbers in groups:
        where = {each.name: None for each in fields(Condition)} if condition is None else asdict(condition)
        for metric in metrics:
            for policy, entry in zip(table.policies, beside_best(table, metric, numbers), strict=True):
                rows.append(
                    {
                        "policy": policy,
                        **where,
                        "metric": metric,
                        "mean": _known(entry.interval.mean),
                        "low": _known(entry.interval.low),
                        "high": _known(entry.interval.high),
                        "samples": entry.interval.count,
                        "complete": entry.complete,
                        "best": entry.best,
                        "p_to_best": _known(entry.p_corrected),
                    }
                )
    return to_csv_text(rows)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
