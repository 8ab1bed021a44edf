"""Compare rankings of policies by simulation and recordings: Spearman's rho, Kendall's tau, bootstrap intervals.

    python scripts/rank_policies.py DATA [--seeds 8] [--frames 100] [--workers 2] [--csv scores.csv]

DATA has v2v4real/val: six recordings of two connected cars. The simulation has two connected cars, no people, no noise
and no latency, and is run with the simulated detector and with the one fitted to V2V4Real, without LiDARs (expected
returns). A policy's score is the mean over recordings, or over simulated episodes; the bootstrap draws both with
replacement. False positives count.
"""

from __future__ import annotations

import argparse
import csv
import itertools
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau, spearmanr
from tabulate import tabulate
from tqdm import tqdm

import coopsim
from coopsim.bench.evaluate import run_episode
from coopsim.catalog import policies_on_boxes
from coopsim.geometry.se3 import Floats
from coopsim.metrics.score import summarize
from coopsim.support.rng import stream

SCENARIOS = ("highway", "crossing", "urban_grid")
DETECTORS = ("simulated", "pointpillars_v2v4real(confusion=None)")  # the recordings have a single class
METRICS = ("sAMOTA", "AMOTA")
AGENTS = ("ego", "1")
DRAWS = 2000
OPTIONS = {"connected_cars": 2, "rsus": 0, "pedestrians": 0, "bicycles": 0, "lidar": None}
Scores = Mapping[str, Floats]
"""By policy (E, M): a row per recording or episode, a column per metric."""


def main() -> None:
    """Read the arguments, run, print."""
    parser = argparse.ArgumentParser(description="Rank correlation of policies, simulated and recorded.")
    parser.add_argument("data", type=Path, help="folder with v2v4real/val")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--csv", type=Path, help="file for all scores")
    args = parser.parse_args()
    policies = policies_on_boxes()
    jobs: dict[tuple[str, str, str], Callable[[], list[list[float]]]] = {
        ("recordings", "real", name): partial(on_recordings, args.data / "v2v4real" / "val", name) for name in policies
    }
    for scenario, detector, name in itertools.product(SCENARIOS, DETECTORS, policies):
        jobs[scenario, detector, name] = partial(in_simulation, scenario, detector, name, args.seeds, args.frames)
    sources: dict[tuple[str, str], dict[str, Floats]] = {key[:2]: {} for key in jobs}
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        futures = {key: pool.submit(job) for key, job in jobs.items()}
        for key in tqdm(jobs):
            sources[key[:2]][key[2]] = np.array(futures[key].result())
    if args.csv is not None:
        write_csv(args.csv, sources)
    print(means_table(sources), "\n")
    print(correlation_table(sources))


def on_recordings(folder: Path, name: str) -> list[list[float]]:
    """Return a policy's scores per recording, for the car that owns the frame."""
    policy = coopsim.make_policy(name)
    env = coopsim.parallel_env(
        "replay", path=folder, detections=AGENTS, uplink=policy.needs.uplink, odometry="none"
    )  # as the published tables, which know of no odometry
    rows = []
    for sequence in env.sequences:
        run_episode(env, policy, seed=0, sequence=sequence)
        score = summarize([env.logs[AGENTS[0]]])
        rows.append([score[metric] for metric in METRICS])
    return rows


def in_simulation(scenario: str, detector: str, name: str, seeds: int, frames: int) -> list[list[float]]:
    """Return a policy's scores per episode, mean over both cars."""
    rows = []
    for seed in range(seeds):
        done = coopsim.evaluate(name, scenario, seed=seed, max_cycles=frames, detector=detector, **OPTIONS)
        rows.append([done.score[metric] for metric in METRICS])
    return rows


def means_table(sources: Mapping[tuple[str, str], Scores]) -> str:
    """Format each policy's mean sAMOTA and rank by source; best on the recordings first."""
    names = list(next(iter(sources.values())))
    means = {source: np.array([scores[name][:, 0].mean() for name in names]) for source, scores in sources.items()}
    for detector in DETECTORS:
        means["all", detector] = np.mean([means[scenario, detector] for scenario in SCENARIOS], axis=0)
    ranks = {source: (-mean).argsort().argsort() + 1 for source, mean in means.items()}
    rows = [
        [name, *(f"{mean[k]:.1f} ({ranks[source][k]})" for source, mean in means.items())]
        for k, name in sorted(enumerate(names), key=lambda each: ranks["recordings", "real"][each[0]])
    ]
    return tabulate(rows, ["policy", *(", ".join(source) for source in means)], tablefmt="github")


def correlation_table(sources: Mapping[tuple[str, str], Scores]) -> str:
    """Format the rank correlations of every simulated source, and of all scenarios together, with the recordings."""
    recorded, rows = _stacked(sources["recordings", "real"]), []
    for detector in DETECTORS:
        parts = {scenario: _stacked(sources[scenario, detector]) for scenario in SCENARIOS}
        for name, simulated in {**parts, "all": np.concatenate(list(parts.values()))}.items():
            for column, metric in enumerate(METRICS):
                rows.append([detector, name, metric, *_intervals(recorded[..., column], simulated[..., column])])
    heads = ["detector", "scenario", "metric", "Spearman's rho (95 %)", "Kendall's tau (95 %)"]
    return tabulate(rows, heads, tablefmt="github")


def _stacked(scores: Scores) -> Floats:
    """Stack scores to (E, P, M): episode, policy, metric."""
    return np.stack(list(scores.values()), axis=1)


def _intervals(recorded: Floats, simulated: Floats) -> list[str]:
    """Format rho and tau of the means over rows of (R, P) and (E, P), with 95 % intervals of a bootstrap over rows."""
    rng = stream(0, "bootstrap")

    def both(one: Floats, other: Floats) -> tuple[float, float]:
        return spearmanr(one.mean(axis=0), other.mean(axis=0)).statistic, kendalltau(
            one.mean(axis=0), other.mean(axis=0)
        ).statistic

    draws = [
        both(*(rows[rng.integers(len(rows), size=len(rows))] for rows in (recorded, simulated))) for _ in range(DRAWS)
    ]
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return [f"{at:.2f} ({a:.2f} to {b:.2f})" for at, a, b in zip(both(recorded, simulated), low, high, strict=True)]


def write_csv(path: Path, sources: Mapping[tuple[str, str], Scores]) -> None:
    """Write all scores, a row per episode."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["scenario", "detector", "policy", "episode", *METRICS])
        for (scenario, detector), scores in sources.items():
            for name, rows in scores.items():
                for episode, row in enumerate(rows):
                    writer.writerow([scenario, detector, name, episode, *row])


if __name__ == "__main__":
    main()
