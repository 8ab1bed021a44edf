"""Measure what covariances that see features bring in simulation, beside constant ones and the detector's own.

    python scripts/measure_seen_covariance.py seen.safetensors places.safetensors constant.safetensors
        [--environments crossing,roundabout,highway] [--seeds 0-3] [--frames 60]

Each file is of `coopsim train dmstrack_seen` with another `network`: {}, {features: 0} and {features: 0, constant:
true}. Of each, `dmstrack` and `coop_fuse` are scored with the covariances that it gives to the same boxes of `pillars`.
Messages have the codec `compact`, which carries covariances.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import coopsim
from coopsim.cli.arguments import names, seeds

SCORES = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "IDS")


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description="Measure what covariances that see features bring.")
    parser.add_argument("weights", nargs="+", help="of covariances, by name or path")
    parser.add_argument("--environments", type=names, default=("crossing", "roundabout", "highway"))
    parser.add_argument("--seeds", type=seeds, default=(0, 1, 2))
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args()
    cases = [("head", "pillars", "sequential_kf"), ("head", "pillars", "coop_fuse")]
    for each in given.weights:
        detector = f"pillars(covariance={each})"
        cases += [(Path(each).stem, detector, f"dmstrack(covariance={each})"), (Path(each).stem, detector, "coop_fuse")]
    print("| covariances | policy |", " | ".join(SCORES), "|", flush=True)
    for name, detector, policy in cases:
        found = [
            coopsim.evaluate(
                policy, place, seed=seed, detector=detector, codec="compact", max_cycles=given.frames
            ).score
            for place in given.environments
            for seed in given.seeds
        ]
        values = np.array([[score[each] for each in SCORES] for score in found])
        error = values.std(axis=0, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.full(len(SCORES), np.nan)
        cells = (f"{mean:.1f} ± {spread:.1f}" for mean, spread in zip(values.mean(axis=0), error, strict=True))
        print(f"| {name} | {policy.split('(')[0]} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
