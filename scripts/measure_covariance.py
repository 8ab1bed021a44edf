"""Measure what learned covariances bring on a set of recordings: calibration and scores by both protocols.

    python scripts/measure_covariance.py RECORDINGS dmstrack path/to/constant.safetensors

RECORDINGS is a folder as V2V4Real's validation recordings. Of each file of weights, `dmstrack` and `coop_fuse` are
scored with it; beside them the policies with fixed noise. As in published tables the car's motion is not used.
"""

from __future__ import annotations

import argparse

import torch

import coopsim
from coopsim.data.recording_set import RecordingSet
from coopsim.learn.losses.filter_losses import recording_errors
from coopsim.learn.samples.windows import frames_of
from coopsim.learn.weights import load_covariance

DT_S = 0.1
SCORES = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "MT")


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description="Measure what learned covariances bring.")
    parser.add_argument("recordings", help="folder with labels/ and detections/")
    parser.add_argument("weights", nargs="+", help="of covariances, by name or path")
    parser.add_argument("--detections", default="ego,1", help="agents, the frame's owner first")
    args = parser.parse_args()
    agents = tuple(args.detections.split(","))
    for name in args.weights:
        print(f"{name}: {calibration(name, args.recordings, agents)}", flush=True)
    cases: list[tuple[str, dict[str, object]]] = [("sequential_kf", {}), ("coop_fuse", {})]
    cases += [(policy, {"covariance": each}) for each in args.weights for policy in ("dmstrack", "coop_fuse")]
    for policy, parameters in cases:
        made = coopsim.make_policy(policy, **parameters)
        found = coopsim.evaluate_recordings(made, args.recordings, agents, odometry="none")
        for protocol, score in (("counted", found.count), ("ignored", found.ignore)):
            values = ", ".join(f"{each} {score[each]:.2f}" for each in SCORES)
            print(f"{policy} {parameters or ''} {protocol}: {values}, IDS {score['IDS']:.1f}", flush=True)


def calibration(weights: str, path: str, agents: tuple[str, ...]) -> str:
    """Return the squared Mahalanobis distances of innovations, mean and median, and the error of updated boxes."""
    folder = RecordingSet(path)
    frames = [frames_of(folder.load(name, agents), DT_S) for name in folder.sequences]
    with torch.no_grad():
        found = recording_errors(load_covariance(weights), frames)
    likelihood = float(found.losses()["innovation"])
    return (
        f"squared Mahalanobis distance of {len(found.distance)} innovations: mean {float(found.distance.mean()):.2f}, "
        f"median {float(found.distance.median()):.2f}; negative log likelihood {likelihood:.2f}; "
        f"error of updated boxes {float(found.error.mean()):.3f}"
    )


if __name__ == "__main__":
    main()
