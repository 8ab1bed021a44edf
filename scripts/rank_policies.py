"""Compare rankings of policies by simulation and recordings: Spearman's rho, Kendall's tau, bootstrap intervals.

    python scripts/rank_policies.py RECORDINGS ranked/*

RECORDINGS are those of two connected cars, as v2v4real/val; in `ranked` are folders of `coopsim bench`, one for each
detector, of the same policies (docs/results/detector_fit.md). A policy's score is the mean over recordings, or over
simulated episodes; the bootstrap draws both with replacement, which no command does. False positives count.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau, spearmanr
from tabulate import tabulate
from tqdm import tqdm

import coopsim
from coopsim.bench.results.result_table import ResultTable
from coopsim.cli.argument_types import names
from coopsim.cli.arguments import stored_results
from coopsim.data.recording_set import RecordingSet
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream

METRICS = ("sAMOTA", "AMOTA")
DRAWS = 2000
RECORDED = ("recordings", "real")
Scores = Mapping[str, Floats]
"""By policy (E, M): a row per recording or episode, a column per metric."""


def main() -> None:
    """Read the arguments, replay the recordings, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, help="folder with labels/ and detections/")
    parser.add_argument("simulated", type=Path, nargs="+", help="folders of `coopsim bench`, of the same policies")
    parser.add_argument("--detections", type=names, default=("ego", "1"), help="agents, the frame's owner first")
    given = parser.parse_args()
    sources: dict[tuple[str, str], Scores] = {}
    for folder in given.simulated:
        sources |= {(scenario, folder.name): scores for scenario, scores in simulated(folder).items()}
    policies = list(next(iter(sources.values())))
    recorded = {policy: on_recordings(given.recordings, policy, given.detections) for policy in tqdm(policies)}
    sources = {RECORDED: recorded, **sources}
    print(means_table(sources), "\n")
    print(correlation_table(sources))


def simulated(folder: Path) -> dict[str, Scores]:
    """Return the scores of a benchmark by scenario and policy."""
    table = ResultTable.of(stored_results(folder))
    values = np.stack([table.values(metric) for metric in METRICS], axis=-1)
    return {
        condition.scenario: {policy: values[k, at] for k, policy in enumerate(table.policies)}
        for at, condition in enumerate(table.conditions)
    }


def on_recordings(folder: Path, policy: str, agents: tuple[str, ...]) -> Floats:
    """Return a policy's scores per recording, of the first agent, without odometry, which published tables lack."""
    scores = [
        coopsim.evaluate_recordings(policy, folder, agents, sequences=[sequence], odometry="none").count.agents[
            agents[0]
        ]
        for sequence in RecordingSet(folder).sequences
    ]
    return np.array([[score[metric] for metric in METRICS] for score in scores])


def means_table(sources: Mapping[tuple[str, str], Scores]) -> str:
    """Format each policy's mean sAMOTA and rank by source; best on the recordings first."""
    policies = list(next(iter(sources.values())))
    means = {source: np.array([scores[name][:, 0].mean() for name in policies]) for source, scores in sources.items()}
    for detector, scenarios in _scenarios(sources).items():
        means["all", detector] = np.mean([means[scenario, detector] for scenario in scenarios], axis=0)
    ranks = {source: (-mean).argsort().argsort() + 1 for source, mean in means.items()}
    rows = [
        [name, *(f"{mean[k]:.1f} ({ranks[source][k]})" for source, mean in means.items())]
        for k, name in sorted(enumerate(policies), key=lambda each: ranks[RECORDED][each[0]])
    ]
    return tabulate(rows, ["policy", *(", ".join(source) for source in means)], tablefmt="github")


def correlation_table(sources: Mapping[tuple[str, str], Scores]) -> str:
    """Format the rank correlations of every simulated source, and of all scenarios together, with the recordings."""
    recorded, rows = _stacked(sources[RECORDED]), []
    for detector, scenarios in _scenarios(sources).items():
        parts = {scenario: _stacked(sources[scenario, detector]) for scenario in scenarios}
        for name, simulated in {**parts, "all": np.concatenate(list(parts.values()))}.items():
            for column, metric in enumerate(METRICS):
                rows.append([detector, name, metric, *rank_correlations(recorded[..., column], simulated[..., column])])
    heads = ["detector", "scenario", "metric", "Spearman's rho (95 %)", "Kendall's tau (95 %)"]
    return tabulate(rows, heads, tablefmt="github")


def _scenarios(sources: Mapping[tuple[str, str], Scores]) -> dict[str, list[str]]:
    """Return the scenarios of each simulated detector."""
    found: dict[str, list[str]] = {}
    for scenario, detector in sources:
        if (scenario, detector) != RECORDED:
            found.setdefault(detector, []).append(scenario)
    return found


def _stacked(scores: Scores) -> Floats:
    """Stack scores to (E, P, M): episode, policy, metric."""
    return np.stack(list(scores.values()), axis=1)


def rank_correlations(recorded: Floats, simulated: Floats) -> list[str]:
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


if __name__ == "__main__":
    main()
