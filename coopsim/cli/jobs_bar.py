"""The bar of commands that run the jobs of a plan."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from coopsim.bench.grid.cell import Condition
    from coopsim.bench.run_jobs import Progress


class JobsBar:
    """A bar over jobs, as a context, which tells of those that fail and how long the others take.

    Args:
        name: text before the bar.
        unit: noun of the jobs, in the plural.
        conditions: conditions of all jobs, among which a failed one is named.
        workers: number of jobs at once.

    Attributes:
        finished: number of finished jobs, stored ones included.
        failed: number of jobs that failed now.
        lost: number of jobs that were not run, for no fault of their own.
    """

    def __init__(self, name: str, unit: str, conditions: Sequence[Condition] = (), workers: int = 1) -> None:
        from tqdm import tqdm

        self.finished = self.failed = self.lost = 0
        self._unit, self._conditions, self._workers = unit, conditions, workers
        # The remaining time is ours: the bar's own assumes that all jobs take equally long.
        shape = f"{{desc}}: {{percentage:3.0f}}%|{{bar}}| {{n_fmt}}/{{total_fmt}} {unit} [{{elapsed}}{{postfix}}]"
        self._bar: Any = tqdm(total=1, disable=None, desc=name, bar_format=shape)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def write(self, text: str) -> None:
        """Print a line of the command above the bar."""
        self._bar.write(f"coopsim: {text}", file=sys.stderr)

    def show(self, progress: Progress) -> None:
        """Show the progress, and tell of a job that has just failed."""
        self._bar.total = progress.cells
        self._bar.n = self.finished = progress.stored + progress.done  # a hidden bar does not count
        if progress.outcome is None:
            self._bar.initial = self.finished
        elif progress.outcome.result.failed:
            from coopsim.bench.grid.labels import name_of_cell

            self.lost += progress.outcome.lost
            self.failed += not progress.outcome.lost
            cell = progress.outcome.result.cell
            where = name_of_cell(cell, self._conditions or [cell.condition])
            self.write(f"failed: {where}: {progress.outcome.reason}")
        if progress.left_s is not None:
            left = self._bar.format_interval(progress.left_s / self._workers)
            self._bar.set_postfix_str(f"about {left} left", refresh=False)
        self._bar.refresh()

    def tell_of_lost(self) -> None:
        """Say how many jobs were not run, if any."""
        if self.lost:
            lost = f"{self.lost} of {self._bar.total} {self._unit} were not run"
            print(f"coopsim: {lost}; the same command runs them", file=sys.stderr)
