"""Measure the tables of simulated runs in docs/results again, and print them.

    python scripts/measure_results.py [poses] [budgets] [codecs] [--seeds 5] [--frames 100] [--workers 2]

Without a name all tables are measured, which takes minutes. Set OMP_NUM_THREADS=1 for the same numbers on every
machine. Each cell is the mean over seeds and agents; differences are paired by seed, with the 95 % interval of
Student's t. All runs are of `late_fusion` with detector="simulated". The tables of docs/results/detector_fit.md are
printed by scripts/plot_detector.py and scripts/rank_policies.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from tabulate import tabulate

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.geometry.se3 import Floats
from coopsim.localization.localizer import LocalizationConfig
from coopsim.localization.pose_noise import PoseNoise

METRICS = ("sAMOTA", "AMOTA", "MOTA", "bytes_per_s")
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Run:
    """A policy in a scenario under some options of the environment."""

    scenario: str
    policy: str = "late_fusion"
    options: tuple[tuple[str, Any], ...] = ()

    def measure(self, frames: int, seed: int) -> list[float]:
        """Run one episode; return its `METRICS`."""
        options = {"detector": "simulated", "seed": seed, "max_cycles": frames, **dict(self.options)}
        score = coopsim.evaluate(self.policy, self.scenario, **options).score
        return [score[metric] for metric in METRICS]


@dataclass(frozen=True)
class Table:
    """A table of a page.

    Attributes:
        heading: the columns' names.
        rows: labels of each row, and its runs.
        metrics: shown for each run.
        differences: pairs of runs of a row; the difference first - second in sAMOTA is shown.
    """

    heading: tuple[str, ...]
    rows: list[tuple[tuple[str, ...], tuple[Run, ...]]]
    metrics: tuple[str, ...] = ("sAMOTA",)
    differences: tuple[tuple[int, int], ...] = ()

    def text(self, values: Mapping[Run, Floats]) -> str:
        """Format the table in Markdown, from values (seeds, metrics) by run."""
        columns = [METRICS.index(metric) for metric in self.metrics]
        rows = []
        for labels, runs in self.rows:
            means = [values[run].mean(axis=0)[column] for run in runs for column in columns]
            gaps = [mean_interval((values[runs[a]] - values[runs[b]])[:, 0]) for a, b in self.differences]
            shown = [f"{mean:.3f}" for mean in means] + [f"{gap.mean:.1f} ± {gap.half_width:.1f}" for gap in gaps]
            rows.append([*labels, *shown])
        return tabulate(rows, self.heading, tablefmt="github", disable_numparse=True)


def poses() -> Table:
    """Define the table of pose correction."""
    white = {
        f"{metres:g} m, {degrees:g} degrees": PoseNoise(metres, degrees * DEGREE)
        for metres, degrees in ((0, 0), (0.2, 0.2), (0.5, 0.5), (1, 1))
    }
    lasting = {
        "0.5 m, 0.5 degrees, correlated over 5 s": PoseNoise(0.5, 0.5 * DEGREE, correlation_s=5.0),
        "constant, 0.5 m, 0.5 degrees": PoseNoise(position_bias_m=0.5, heading_bias_rad=0.5 * DEGREE),
    }
    rows = []
    for scenario, noises in (("crossing", {**white, **lasting}), ("highway", white)):
        for name, noise in noises.items():
            options = (("localization", LocalizationConfig(noise)),)
            runs = (Run(scenario, "late_fusion", options), Run(scenario, "late_fusion(align=True)", options))
            rows.append(((scenario, name), runs))
    return Table(
        ("scenario", "noise of all poses", "as it is", "align=True", "difference"), rows, differences=((1, 0),)
    )


def budgets() -> Table:
    """Define the table of byte budgets."""
    selections = ("random", "score", "need")
    rows = [
        (
            (scenario, str(budget)),
            tuple(
                Run(scenario, options=(("budget_bytes", budget), ("selection", selection))) for selection in selections
            ),
        )
        for scenario, budget in (("crossing", 150), ("crossing", 240), ("highway", 150))
    ]
    heading = ("scenario", "budget_bytes", *selections, "need less score", "need less random")
    return Table(heading, rows, differences=((2, 1), (2, 0)))


def codecs() -> Table:
    """Define the table of codecs of detections, compared with no messages."""
    rows = [((name,), (Run("crossing", options=(("codec", name),)),)) for name in ("detections", "compact", "cpm")]
    rows.append((("(no_fusion)",), (Run("crossing", "no_fusion"),)))
    return Table(("codec", *METRICS), rows, metrics=METRICS)


TABLES: Mapping[str, Callable[[], Table]] = {"poses": poses, "budgets": budgets, "codecs": codecs}


def measure(run: Run, seeds: int, frames: int) -> Floats:
    """Return the values (seeds, metrics) of a run."""
    return np.array([run.measure(frames, seed) for seed in range(seeds)])


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description="Measure the tables of docs/results again.")
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"of {', '.join(TABLES)}; default: all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    args = parser.parse_args()
    if unknown := set(args.tables) - set(TABLES):
        parser.error(f"no table {', '.join(sorted(unknown))}; accepted: {', '.join(TABLES)}")
    tables = {name: TABLES[name]() for name in args.tables or TABLES}
    runs = list(dict.fromkeys(run for table in tables.values() for _, row in table.rows for run in row))
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        values = dict(zip(runs, pool.map(partial(measure, seeds=args.seeds, frames=args.frames), runs), strict=True))
    for table in tables.values():
        print(f"\n{table.text(values)}")


if __name__ == "__main__":
    main()
