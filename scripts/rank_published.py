"""Compare the order of methods by `coopsim detect` with published orders: Spearman's rho and rank violations.

    python scripts/rank_published.py ranked/clean/*.json
    python scripts/rank_published.py ranked/residual/*.json --metric APBEV@0.7

Each file is of one place, with a row for each method. A method's score is its mean over places; the bootstrap draws
places with replacement. The mean maximum rank violation is the mean over methods of the largest difference of two
published scores, per cent, that is the other way round here (SimplerEnv, Li et al., CoRL 2024, section 4).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr
from tabulate import tabulate

from coopsim.catalog import PolicySpec
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream

PUBLISHED = {
    "V2V4Real, AP@0.5": {
        "late_fusion": 55.0,
        "early": 59.7,
        "fcooper": 60.7,
        "attfuse": 64.5,
        "v2vnet": 64.7,
        "v2x_vit": 64.9,
        "cobevt": 66.5,
    },
    "V2XSet, noisy, AP@0.5": {
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
"""Scores in per cent by table and policy, as docs/results/detection.md cites them. Late fusion and early fusion, whose
order hangs on the errors of poses, are left out of the second column."""

BASELINES = ("late_fusion", "early")
DRAWS = 2000


def main() -> None:
    """Read the arguments and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", type=Path, nargs="+", help="files of `coopsim detect --json`, one for each place")
    parser.add_argument("--metric", default="APBEV@0.5", help="column of the rows (default: %(default)s)")
    given = parser.parse_args()
    print(table([json.loads(path.read_text(encoding="utf-8")) for path in given.places], given.metric))


def table(places: Sequence[Sequence[dict[str, object]]], metric: str) -> str:
    """Format rho and rank violations of both protocols beside every published table."""
    rows = []
    for protocol in ("coopsim", "opencood"):
        scores = by_policy(places, metric, protocol)
        for name, published in PUBLISHED.items():
            known = [policy for policy in published if policy in scores]
            fusions = [policy for policy in known if policy not in BASELINES]
            cells = [agreement(scores, published, chosen) for chosen in (known, fusions)]
            rows.append([protocol, name, len(known), *cells[0], len(fusions), *cells[1]])
    heads = ["protocol", "published", "methods", "rho", "violation", "fusions of features", "rho", "violation"]
    return tabulate(rows, heads, tablefmt="github")


def by_policy(places: Sequence[Sequence[dict[str, object]]], metric: str, protocol: str) -> dict[str, Floats]:
    """Return a method's scores (P,) by name, one for each place."""
    found: dict[str, list[float]] = {}
    for rows in places:
        for row in rows:
            values = row if protocol == row["protocol"] else row[protocol]
            assert isinstance(values, dict)
            found.setdefault(PolicySpec.parse(str(row["policy"])).target, []).append(float(values[metric]))
    return {policy: np.array(values) for policy, values in found.items()}


def agreement(scores: dict[str, Floats], published: dict[str, float], policies: Sequence[str]) -> list[str]:
    """Format rho with its 95 % interval over places, and the mean maximum rank violation."""
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
    return [f"{spearmanr(mean, there).statistic:.2f} ({low:.2f} to {high:.2f})", f"{violation:.1f}"]


if __name__ == "__main__":
    main()
