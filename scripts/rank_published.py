"""Compare the order of methods here with published orders: Spearman's rho and rank violations.

    python scripts/rank_published.py ranked/clean/*.json
    python scripts/rank_published.py ranked/residual/*.json --metric APBEV@0.7
    python scripts/rank_published.py tracked/results.csv --metric AMOTA

Files of `coopsim detect --json` are of one place each, with a row for each method. The `results.csv` of `coopsim bench`
has all places, in one condition. A method's score is its mean over places; the bootstrap draws places with replacement.
The mean maximum rank violation is the mean over methods of the largest difference of two published scores, per cent,
that is the other way round here (SimplerEnv, Li et al., CoRL 2024, section 4).
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr
from tabulate import tabulate

from coopsim.catalog import PolicySpec
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream

PUBLISHED = {
    "V2V4Real, AP@0.5": {
        "no_fusion": 39.8,
        "late_fusion": 55.0,
        "early": 59.7,
        "fcooper": 60.7,
        "attfuse": 64.5,
        "v2vnet": 64.7,
        "v2x_vit": 64.9,
        "cobevt": 66.5,
    },
    "V2V4Real, 100 ms, AP@0.5": {
        "no_fusion": 39.8,
        "late_fusion": 50.2,
        "early": 52.1,
        "fcooper": 53.6,
        "attfuse": 56.4,
        "v2vnet": 57.7,
        "v2x_vit": 55.9,
        "cobevt": 58.6,
    },
    "V2XSet, noisy, AP@0.5": {
        "no_fusion": 60.6,
        "late_fusion": 54.9,
        "attfuse": 70.9,
        "fcooper": 71.5,
        "early": 72.0,
        "v2vnet": 79.1,
        "disconet": 79.8,
        "cobevt": 81.1,
        "where2comm": 82.0,
        "v2x_vit": 83.6,
    },
    "OPV2V, AP@0.7": {
        "late_fusion": 78.1,
        "fcooper": 79.0,
        "early": 80.0,
        "attfuse": 81.5,
        "v2vnet": 82.2,
        "cobevt": 86.1,
    },
}
"""Average precisions in per cent by table and policy: READMEs of V2V4Real, V2X-ViT and OpenCOOD."""

TRACKED = {
    "V2V4Real, AMOTA": {
        "no_fusion": 16.08,
        "late_fusion": 29.28,
        "early": 26.19,
        "fcooper": 23.29,
        "attfuse": 28.64,
        "v2vnet": 30.48,
        "v2x_vit": 30.85,
        "cobevt": 32.12,
    },
    "V2V4Real, sAMOTA": {
        "no_fusion": 53.84,
        "late_fusion": 71.05,
        "early": 67.34,
        "fcooper": 65.63,
        "attfuse": 73.21,
        "v2vnet": 75.53,
        "v2x_vit": 74.01,
        "cobevt": 77.65,
    },
}
"""The same of tracking, by AB3DMOT, from V2V4Real's README."""

BASELINES = ("no_fusion", "late_fusion", "early")
DRAWS = 2000


def main() -> None:
    """Read the arguments and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", help="files of `coopsim detect --json`, or results.csv")
    parser.add_argument("--metric", default="APBEV@0.5", help="column of the rows (default: %(default)s)")
    given = parser.parse_args()
    if given.results[0].suffix == ".csv":
        print(table({"": tracked(given.results[0], given.metric)}, TRACKED))
        return
    places = [json.loads(path.read_text(encoding="utf-8")) for path in given.results]
    print(table({name: detected(places, given.metric, name) for name in ("coopsim", "opencood")}, PUBLISHED))


def table(found: Mapping[str, Mapping[str, Floats]], published: Mapping[str, Mapping[str, float]]) -> str:
    """Format rho and rank violations beside every published table, for each protocol's scores by policy."""
    rows = []
    for protocol, scores in found.items():
        for name, there in published.items():
            known = [policy for policy in there if policy in scores]
            sharing = [policy for policy in known if policy != "no_fusion"]
            fusions = [policy for policy in known if policy not in BASELINES]
            row = [cell for chosen in (known, sharing, fusions) for cell in agreement(scores, there, chosen)]
            rows.append([protocol, name, *row])
    groups = ("all", "that share", "of features")
    heads = [f"{what} {group}" for group in groups for what in ("methods", "rho", "violation")]
    return tabulate(rows, ["protocol", "published", *heads], tablefmt="github")


def detected(places: Sequence[Sequence[dict[str, object]]], metric: str, protocol: str) -> dict[str, Floats]:
    """Return a method's scores (P,) by name, one for each place."""
    found: dict[str, list[float]] = {}
    for rows in places:
        for row in rows:
            values = row if protocol == row["protocol"] else row[protocol]
            assert isinstance(values, dict)
            found.setdefault(PolicySpec.parse(str(row["policy"])).target, []).append(float(values[metric]))
    return {policy: np.array(values) for policy, values in found.items()}


def tracked(results: Path, metric: str) -> dict[str, Floats]:
    """Return a method's scores (P,) by name, one for each place; of one name, those of its best setting."""
    found: dict[str, dict[str, list[float]]] = {}
    with results.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            settings = found.setdefault(PolicySpec.parse(row["policy"]).target, {})
            settings.setdefault(row["policy"], []).append(float(row[metric]))
    return {name: np.array(max(settings.values(), key=np.mean)) for name, settings in found.items()}


def agreement(scores: Mapping[str, Floats], published: Mapping[str, float], policies: Sequence[str]) -> list[object]:
    """Return the number of methods, rho with its 95 % interval over places, and the mean maximum rank violation."""
    here = np.array([scores[policy] for policy in policies])
    there = np.array([published[policy] for policy in policies])
    rng = stream(0, "bootstrap")
    draws = [
        spearmanr(here[:, rng.integers(here.shape[1], size=here.shape[1])].mean(axis=1), there).statistic
        for _ in range(DRAWS)
    ]
    low, high = np.nanquantile(draws, [0.025, 0.975])
    mean = here.mean(axis=1)
    wrong = (mean[:, None] < mean) != (there[:, None] < there)
    violation = (np.abs(there[:, None] - there) * wrong).max(axis=1).mean()
    rho = spearmanr(mean, there).statistic
    return [len(policies), f"{rho:.2f} ({low:.2f} to {high:.2f})", f"{violation:.1f}"]


if __name__ == "__main__":
    main()
