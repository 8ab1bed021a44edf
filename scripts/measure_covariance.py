"""Measure how well learned covariances are calibrated on a set of recordings.

    python scripts/measure_covariance.py RECORDINGS dmstrack path/to/constant.safetensors

RECORDINGS is a folder as V2V4Real's validation recordings. No command looks at a filter's innovations; what tracks gain
by covariances is `coopsim leaderboard`'s.
"""

from __future__ import annotations

import argparse

import torch

from coopsim.cli.argument_types import names
from coopsim.data.recording_set import RecordingSet
from coopsim.learn.losses.filter_losses import recording_errors
from coopsim.learn.samples.windows import frames_of
from coopsim.learn.weights import load_covariance

DT_S = 0.1


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", help="folder with labels/ and detections/")
    parser.add_argument("weights", nargs="+", help="of covariances, by name or path")
    parser.add_argument("--detections", type=names, default=("ego", "1"), help="agents, the frame's owner first")
    given = parser.parse_args()
    folder = RecordingSet(given.recordings)
    frames = [frames_of(folder.load(name, given.detections), DT_S) for name in folder.sequences]
    for weights in given.weights:
        with torch.no_grad():
            found = recording_errors(load_covariance(weights), frames)
        likelihood = float(found.losses()["innovation"])
        print(
            f"{weights}: squared Mahalanobis distance of {len(found.distance)} innovations: mean "
            f"{float(found.distance.mean()):.2f}, median {float(found.distance.median()):.2f}; negative log likelihood "
            f"{likelihood:.2f}; error of updated boxes {float(found.error.mean()):.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
