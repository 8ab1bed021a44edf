"""Learn what `coop_fuse` ships: which agent's box to believe, how likely it is right, and how likely a track is.

    python scripts/fit_coop_fuse.py RECORDINGS [--without 0000] [--frames 150]

RECORDINGS is a folder with labels and the detections of two agents or more, the frame's owner first, as
V2V4Real's training recordings have them. Recording 0000 is left out unless told otherwise: it is one of those that
coop_fuse is tested on. The first frames of each recording are used, so that no long one dominates. Prints the weights,
and what they give on the same frames and on each third of the recordings with weights from the other two: on all
recordings together, and on average over draws of six, because six are what coop_fuse is tested on. How many levels of
recall are reached jumps from one to the next, and with them all averages; the draws smooth that.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from coopsim.agents.coop_fuse import LEAST_CHANCE, LIKELIHOOD, MERGE_GATE, CoopFuse
from coopsim.data.recording import Recording, RecordingSet
from coopsim.fusion.calibration import Calibration
from coopsim.fusion.compromise import bottom
from coopsim.fusion.trust import Doubt, away_from_middle, pair_features, trust_likelier
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev, iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.log import TrackLog
from coopsim.metrics.score import summarize
from coopsim.rng import stream
from coopsim.tracking.assignment import hungarian
from coopsim.tracking.scoring import Likelihood
from coopsim.types import Mask

ON_OBJECT = 0.25
"""3D IoU from which on a box is right, as the benchmark has it."""

NS_PER_FRAME = 100_000_000
RIDGE = 1e-3
FOLDS = 3
DRAWS, DRAWN = 60, 6
_TRACK_WEIGHTS = ("bias", "mean", "latest")


@dataclass(frozen=True)
class Weights:
    """What is learned."""

    doubt: Doubt
    calibration: Calibration
    likelihood: Likelihood


def main() -> None:
    """Read the arguments, fit, print."""
    parser = argparse.ArgumentParser(description="Learn what coop_fuse ships.")
    parser.add_argument("recordings", help="folder with labels/ and detections/")
    parser.add_argument("--detections", default="ego,1", help="agents, the frame's owner first")
    parser.add_argument("--without", nargs="*", default=["0000"], help="recordings to leave out")
    parser.add_argument("--frames", type=int, default=150, help="of each recording")
    args = parser.parse_args()
    folder, agents = RecordingSet(args.recordings), tuple(args.detections.split(","))
    kept = [name for name in folder.sequences if name not in args.without]
    recordings = [folder.load(name, agents) for name in kept]
    weights = fit(recordings, args.frames)
    print(weights.doubt, weights.calibration, weights.likelihood, sep="\n")
    report("the same recordings", figures([log_of(each, weights, args.frames) for each in recordings]))
    held_out = []
    for fold in range(FOLDS):
        others = [each for k, each in enumerate(recordings) if k % FOLDS != fold]
        learned = fit(others, args.frames)
        held_out += [log_of(each, learned, args.frames) for each in recordings[fold::FOLDS]]
    report("recordings held out", figures(held_out))
    report(f"{DRAWN} of them, mean of {DRAWS} draws", figures_of_draws(held_out))


def fit(recordings: Sequence[Recording], frames: int) -> Weights:
    """Learn from labelled recordings."""
    doubt = Doubt(*_logistic(*_pairs(recordings, frames)))
    calibration = Calibration(*_logistic(*_fused(recordings, frames, doubt)))
    learned = _logistic(*_reports(recordings, frames, CoopFuse(doubt=doubt, calibration=calibration)))
    likelihood = replace(LIKELIHOOD, **dict(zip(_TRACK_WEIGHTS, learned, strict=True)))
    return Weights(doubt, calibration, likelihood)


def log_of(recording: Recording, weights: Weights, frames: int) -> TrackLog:
    """What coop_fuse with these weights reports on a recording."""
    evaluator = Evaluator(ON_OBJECT)
    policy = CoopFuse(doubt=weights.doubt, calibration=weights.calibration, likelihood=weights.likelihood)
    tracker = policy.make_tracker()
    for frame in range(min(recording.frames, frames)):
        groups = [found[frame] for found in recording.detections.values()]
        evaluator.update(recording.truth[frame], tracker.step(policy.fuse(groups)[0], frame * NS_PER_FRAME))
    return evaluator.log


def report(name: str, values: Floats) -> None:
    """Print the `figures`."""
    print("{}: counted sAMOTA {:.2f}, AMOTA {:.2f}; ignored AMOTA {:.2f}".format(name, *values))


def figures(logs: Sequence[TrackLog]) -> Floats:
    """What counts, (3,) per cent: sAMOTA and AMOTA with false positives counted, AMOTA with them ignored."""
    counted = summarize(logs)
    return np.array([counted["sAMOTA"], counted["AMOTA"], counted.ignoring_false_positives()["AMOTA"]])


def figures_of_draws(logs: Sequence[TrackLog]) -> Floats:
    """The mean of the figures over draws of some of the recordings."""
    rng, drawn = stream(0, "draws of recordings"), min(DRAWN, len(logs))
    draws = [figures([logs[k] for k in rng.choice(len(logs), drawn, replace=False)]) for _ in range(DRAWS)]
    mean: Floats = np.mean(draws, axis=0)
    return mean


def _pairs(recordings: Sequence[Recording], frames: int) -> tuple[Floats, Mask]:
    """Features of two agents' boxes on one object of which one is right, and whether that is the other's."""
    features, theirs_right = [], []
    for recording in recordings:
        first, *others = recording.detections.values()
        for frame in range(min(recording.frames, frames)):
            truth = recording.truth[frame].boxes.array
            for own, other in ((first[frame], each[frame]) for each in others):
                mine, theirs = hungarian(giou_bev(own.boxes.array, other.boxes.array), MERGE_GATE)
                own_right = _right(own.boxes[mine], truth)
                other_right = _right(other.boxes[theirs], truth)
                one = own_right != other_right
                gap_m = bottom(other.boxes[theirs]) - bottom(own.boxes[mine])
                away = away_from_middle(own)[mine], away_from_middle(other)[theirs]
                features.append(pair_features(own.score[mine], other.score[theirs], *away, gap_m)[one])
                theirs_right.append(other_right[one])
    return np.concatenate(features), np.concatenate(theirs_right)


def _fused(recordings: Sequence[Recording], frames: int, doubt: Doubt) -> tuple[Floats, Mask]:
    """Features of all fused boxes, and whether each is on an object."""
    features, right = [], []
    for recording in recordings:
        for frame in range(min(recording.frames, frames)):
            groups = [found[frame] for found in recording.detections.values()]
            believed = trust_likelier(groups, MERGE_GATE, doubt, LEAST_CHANCE)
            features.append(Calibration.features(believed))
            right.append(_on_object(believed.found.boxes.array, recording.truth[frame].boxes.array))
    return np.concatenate(features), np.concatenate(right)


def _reports(recordings: Sequence[Recording], frames: int, policy: CoopFuse) -> tuple[Floats, Mask]:
    """Features of all tracks in all frames, and whether each is on an object."""
    features, right = [], []
    for recording in recordings:
        tracker = policy.make_tracker()
        for frame in range(min(recording.frames, frames)):
            groups = [found[frame] for found in recording.detections.values()]
            tracker.step(policy.fuse(groups)[0], frame * NS_PER_FRAME)
            tracked = tracker.state.tracked
            features.append(Likelihood.features(tracked))
            right.append(_on_object(tracked.boxes, recording.truth[frame].boxes.array))
    return np.concatenate(features), np.concatenate(right)


def _on_object(boxes: Floats, truth: Floats) -> Mask:
    """Which boxes (N, 7) are on an object, at most one on each."""
    on_object = np.zeros(len(boxes), dtype=bool)
    on_object[hungarian(iou_3d(boxes, truth), ON_OBJECT)[0]] = True
    return on_object


def _right(boxes: Boxes3D, truth: Floats) -> Mask:
    right: Mask = iou_3d(boxes.array, truth).max(axis=1, initial=0.0) >= ON_OBJECT
    return right


def _logistic(features: Floats, right: Mask) -> list[float]:
    """Weights of a logistic regression, bias first; a slight ridge on standardised features keeps them finite."""
    middle, spread = features.mean(axis=0), features.std(axis=0) + 1e-9
    columns = np.column_stack([np.ones(len(features)), (features - middle) / spread])
    sign = np.where(right, 1.0, -1.0)

    def loss(weights: Floats) -> tuple[float, Floats]:
        margin = sign * (columns @ weights)
        slope = -sign / (1.0 + np.exp(margin))
        ridge = np.append(0.0, RIDGE * weights[1:])
        return float(np.logaddexp(0.0, -margin).mean() + ridge @ weights / 2), columns.T @ slope / len(sign) + ridge

    fitted = minimize(loss, np.zeros(columns.shape[1]), jac=True).x
    weights = fitted[1:] / spread
    return [round(float(weight), 4) for weight in (fitted[0] - weights @ middle, *weights)]


if __name__ == "__main__":
    main()
