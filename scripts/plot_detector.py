"""Compare the fitted detector and the old default with the real one: a figure and a table.

    python scripts/plot_detector.py DATA [--out detector.svg] [--seeds 8]

DATA has v2v4real/train. The simulation is highway and urban_grid with two connected cars and no people, without LiDARs
(expected returns). The table has Kolmogorov-Smirnov distances, from 0 (alike) to 1, between real and simulated
quantities: the mean over bins of range for quantities that depend on it. No command looks at a detector's errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from detector_matches import AGENTS, Matches, read_matches, simulate_matches
from fit_detector import LAGS, QUARTER, RANGES_M, WITHOUT, _bins, _normal_scores, _pairs
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import ndtr
from scipy.stats import ks_2samp, mannwhitneyu
from tabulate import tabulate

from coopsim.detection.presets import preset
from coopsim.detection.simulated.correlated import ERRORS
from coopsim.geometry.se3 import Floats
from coopsim.viz.charts import COLORS, to_svg

PRESET = "pointpillars_v2v4real"
ENVIRONMENTS = ("highway", "urban_grid")
OPTIONS = {"connected_cars": 2, "rsus": 0, "pedestrians": 0, "bicycles": 0, "max_cycles": 150}
COLOR_OF = {"real": "black", "default": COLORS[1], PRESET: COLORS[0]}
UNITS = {"along": "m", "across": "m", "up": "m", "length": "log", "width": "log", "height": "log", "yaw": "rad"}
FEWEST = 30
"""A bin with fewer objects than this, real or simulated, is left out."""


def main() -> None:
    """Read the arguments, run, draw, print."""
    parser = argparse.ArgumentParser(description="Draw real and simulated detections.")
    parser.add_argument("data", type=Path, help="folder with v2v4real/train")
    parser.add_argument("--out", type=Path, default=Path("detector.svg"))
    parser.add_argument("--seeds", type=int, default=8)
    args = parser.parse_args()
    seeds = range(args.seeds)
    every = {
        "real": read_matches(args.data / "v2v4real" / "train", WITHOUT)[AGENTS[0]],
        "default": simulate_matches("simulated", ENVIRONMENTS, seeds, **OPTIONS),
        PRESET: simulate_matches(PRESET, ENVIRONMENTS, seeds, **OPTIONS),
    }
    args.out.write_text(draw(every), encoding="utf-8")
    print(table(every))


def seen(matches: Matches) -> dict[str, Floats]:
    """Return the objects visible to the car, within the real detector's reach."""
    config = preset(PRESET)
    inside = matches.within((config.reach_x_m, config.reach_y_m))
    return {name: column[inside] for name, column in matches.objects.items()}


def table(every: dict[str, Matches]) -> str:
    """Format the distances of both simulated detectors from the real one."""
    rows = []
    for name, distance in DISTANCES.items():
        real, default, fitted = every.values()
        rows.append([name, distance(real, default), distance(real, fitted)])
    return tabulate(rows, ["what", "default", PRESET], tablefmt="github", floatfmt=".2f")


def draw(every: dict[str, Matches]) -> str:
    """Draw all panels, as SVG."""

    def panels(figure: Figure) -> None:
        axes = iter(figure.subplots(5, 4).ravel())
        for panel in (_recall_by_returns, _recall_by_range, _scores_of_true, _scores_of_false, _scores_by_range):
            panel(next(axes), every)
        for name in ERRORS:
            _errors_by_range(next(axes), every, name)
        for panel in (_false_per_frame, _false_by_range):
            panel(next(axes), every)
        for name in ("found", "score", "along", "across", "up", "yaw"):
            _over_time(next(axes), every, name)
        figure.suptitle("Black: real. Blue: fitted. Orange: simulated. Errors: median and middle 68 % and 95 %.")

    return to_svg(panels, 13, 15)


def _recall_by_returns(axes: Axes, every: dict[str, Matches]) -> None:
    edges = np.geomspace(1, 3000, 12)
    for name, matches in every.items():
        table = seen(matches)
        bins = [rows for rows in _bins(table["returns"], edges) if len(rows) >= FEWEST]
        at = [np.median(table["returns"][rows]) for rows in bins]
        axes.plot(at, [table["found"][rows].mean() for rows in bins], color=COLOR_OF[name])
    axes.set(title="recall", xlabel="expected returns", xscale="log", ylim=(0, 1))
    axes.xaxis.set_major_formatter("{x:g}")  # numbers as text: formulas would show their source


def _recall_by_range(axes: Axes, every: dict[str, Matches]) -> None:
    edges = np.arange(0, 101, 5)
    for name, matches in every.items():
        table = matches.objects
        bins = [rows for rows in _bins(table["range"], edges) if len(rows) >= FEWEST]
        at = [table["range"][rows].mean() for rows in bins]
        axes.plot(at, [table["found"][rows].mean() for rows in bins], color=COLOR_OF[name])
    axes.set(title="recall, hidden objects included", xlabel="range (m)", ylim=(0, 1), xlim=(0, 100))


def _scores_of_true(axes: Axes, every: dict[str, Matches]) -> None:
    for name, matches in every.items():
        table = seen(matches)
        _outline(axes, table["score"][table["found"]], np.linspace(0, 1, 41), name)
    axes.set(title="scores, on objects", xlabel="score", yticks=[])


def _scores_of_false(axes: Axes, every: dict[str, Matches]) -> None:
    for name, matches in every.items():
        _outline(axes, matches.false["score"], np.linspace(0, 1, 41), name)
    axes.set(title="scores, false", xlabel="score", yticks=[])


def _scores_by_range(axes: Axes, every: dict[str, Matches]) -> None:
    for name, matches in every.items():
        _quantiles(axes, seen(matches), "score", name)
    axes.set(title="score on objects", xlabel="range (m)", ylim=(0, 1))


def _errors_by_range(axes: Axes, every: dict[str, Matches], error: str) -> None:
    for name, matches in every.items():
        _quantiles(axes, seen(matches), error, name)
    axes.set(title=f"error {error} ({UNITS[error]})", xlabel="range (m)")


def _false_per_frame(axes: Axes, every: dict[str, Matches]) -> None:
    for name, matches in every.items():
        _outline(axes, _counts(matches), np.arange(-0.5, 26), name)
    axes.set(title="false per frame", xlabel="how many", yticks=[])


def _false_by_range(axes: Axes, every: dict[str, Matches]) -> None:
    edges = np.arange(0, 81, 5)
    for name, matches in every.items():
        counts = np.histogram(matches.false["range"], edges)[0] / matches.frames
        axes.stairs(counts, edges, color=COLOR_OF[name])
    axes.set(title="false per frame and 5 m of range", xlabel="range (m)")


def _over_time(axes: Axes, every: dict[str, Matches], name: str) -> None:
    for kind, matches in every.items():
        axes.plot(LAGS / 10, _correlations(seen(matches), name), color=COLOR_OF[kind], marker=".")
    what = {"found": "being found", "score": "score"}.get(name, f"error {name}")
    axes.set(title=f"autocorrelation: {what}", xlabel="s", xscale="log", ylim=(-0.1, 1))
    axes.xaxis.set_major_formatter("{x:g}")


def _outline(axes: Axes, value: Floats, edges: Floats, name: str) -> None:
    axes.stairs(np.histogram(value, edges)[0] / len(value), edges, color=COLOR_OF[name])


def _quantiles(axes: Axes, table: dict[str, Floats], column: str, name: str) -> None:
    hit = table["found"].astype(bool)
    bins = [rows for rows in _bins(table["range"][hit], RANGES_M) if len(rows) >= FEWEST]
    at = [table["range"][hit][rows].mean() for rows in bins]
    wanted = ndtr([-1.96, -QUARTER, 0, QUARTER, 1.96])
    lines = np.array([np.quantile(table[column][hit][rows], wanted) for rows in bins]).T
    for line, style in zip(lines, (":", "--", "-", "--", ":"), strict=True):
        axes.plot(at, line, style, color=COLOR_OF[name], linewidth=1)


def _counts(matches: Matches) -> Floats:
    """Count false detections in each frame that has an object."""
    keys = [table["episode"] * 1e5 + table["frame"] for table in (matches.objects, matches.false)]
    frames = np.unique(np.concatenate(keys))
    return np.bincount(np.searchsorted(frames, keys[1]), minlength=len(frames)).astype(np.float64)


def _correlations(table: dict[str, Floats], name: str) -> Floats:
    """Return the autocorrelation after each of `LAGS`: of a column by its ranks within bins of range, or of `found`."""
    found = table["found"].astype(bool)
    normal = (
        found - found.mean()
        if name == "found"
        else _normal_scores(table["range"], np.where(found, table[name], np.nan))
    )
    scale = np.nanvar(normal)
    pairs = [_pairs(table, lag) for lag in LAGS]
    return np.array([np.nanmean(normal[first] * normal[second]) / scale for first, second in pairs])


def _by_range(column: str) -> Callable[[Matches, Matches], float]:
    def distance(real: Matches, simulated: Matches) -> float:
        apart = []
        parts = [
            [table[column][hit][rows] for rows in _bins(table["range"][hit], RANGES_M)]
            for table in map(seen, (real, simulated))
            for hit in [table["found"].astype(bool)]
        ]
        for one, other in zip(*parts, strict=True):
            if min(len(one), len(other)) >= FEWEST:
                apart.append(ks_2samp(one, other).statistic)
        return float(np.mean(apart))

    return distance


def _recall_apart(real: Matches, simulated: Matches) -> float:
    edges = np.array([1, 3, 6, 12, 25, 50, 100, 200, 400, 1e5])
    one, other = (
        [(table["found"][rows]) for rows in _bins(table["returns"], edges)] for table in map(seen, (real, simulated))
    )
    gaps = [abs(a.mean() - b.mean()) for a, b in zip(one, other, strict=True) if min(len(a), len(b)) >= FEWEST]
    return float(np.mean(gaps))


def _over_time_apart(name: str) -> Callable[[Matches, Matches], float]:
    def distance(real: Matches, simulated: Matches) -> float:
        one, other = (_correlations(seen(each), name) for each in (real, simulated))
        return float(np.nanmean(np.abs(one - other)))

    return distance


def _false_apart(column: str) -> Callable[[Matches, Matches], float]:
    return lambda real, simulated: float(ks_2samp(real.false[column], simulated.false[column]).statistic)


def told_by_underside(matches: Matches) -> float:
    """Return the area under the ROC curve of telling false boxes by how far off the ground they stand; 0.5: none."""
    of_objects, of_false = (np.abs(table["off"][~np.isnan(table["off"])]) for table in (seen(matches), matches.false))
    return float(mannwhitneyu(of_false, of_objects).statistic / len(of_false) / len(of_objects))


DISTANCES: dict[str, Callable[[Matches, Matches], float]] = {
    "recall against returns (mean difference)": _recall_apart,
    "score on objects": _by_range("score"),
    "score of false ones": _false_apart("score"),
    **{f"error {name}": _by_range(name) for name in ERRORS},
    "heading reported": lambda real, fake: float(
        ks_2samp(*(table["turned"][table["found"].astype(bool)] for table in map(seen, (real, fake)))).statistic
    ),
    "false ones per frame": lambda real, fake: float(ks_2samp(_counts(real), _counts(fake)).statistic),
    "range of false ones": _false_apart("range"),
    "false ones told by their underside (difference of areas)": lambda real, fake: abs(
        told_by_underside(real) - told_by_underside(fake)
    ),
    **{f"autocorrelation of {name} (mean difference)": _over_time_apart(name) for name in ("found", "score", *ERRORS)},
}


if __name__ == "__main__":
    main()
