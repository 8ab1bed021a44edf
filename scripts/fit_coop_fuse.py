"""Learn the weights of `coop_fuse`: which agent's box to trust, and how likely a box or a track is right.

    python scripts/fit_coop_fuse.py RECORDINGS [--without 0000] [--frames 150]
    python scripts/fit_coop_fuse.py --towns 100000-100007 --detector pillars --frames 40

RECORDINGS is a folder with labels and the detections of two agents or more, the frame's owner first, as
V2V4Real's training recordings have them. Recording 0000 is left out by default: it is one of those that coop_fuse is
tested on. Only the first frames of each recording are used, so that no long one dominates. Prints the weights and their
scores on the same frames and in threefold cross-validation: on all recordings together, and on average over draws of
six, because coop_fuse is tested on six. The number of recall levels that are reached is an integer, and all averages
jump with it; the draws smooth that.

With `--towns` the recordings are drawn towns, of seeds that networks are trained with: each receiver's own boxes and
those it hears, by one of coopsim's detectors.

The folds are blocks of recordings, because successive recordings are alike: with every third recording held out,
weights that know their roads would score too well.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from coopsim.agents.boxes import LateFusion
from coopsim.agents.coop_fuse import LEAST_CHANCE, LIKELIHOOD, MERGE_GATE, CoopFuse, Weights
from coopsim.cli.argument_types import seeds
from coopsim.data.recording_set import Recording, RecordingSet
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.fusion.box_fusion import correspond_rows, trust_likelier
from coopsim.fusion.compromise import ON_OBJECT
from coopsim.fusion.fused_boxes import AWAY, BOX, SCORE, Calibration, SourceOdds, pair_features, rows_of_agent
from coopsim.geometry.assignment import greedy
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import SE3, Floats
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.metrics.track_log import TrackLog
from coopsim.provided import listening_env
from coopsim.support.rng import stream
from coopsim.tracking.lifecycle import Likelihood
from coopsim.types import Detections, GroundTruth, Mask, Observation, Tracks
from coopsim.types.valid_detections import drop_invalid

NS_PER_FRAME = 100_000_000
RIDGE = 1e-3
FOLDS = 3
DRAWS, DRAWN = 60, 6
_TRACK_WEIGHTS = ("bias", "mean", "latest", "young", "missed")


def main() -> None:
    """Read the arguments, fit, print."""
    parser = argparse.ArgumentParser(description="Learn what coop_fuse ships.")
    parser.add_argument("recordings", nargs="?", help="folder with labels/ and detections/")
    parser.add_argument("--towns", type=seeds, default=(), help="seeds of towns to learn from instead")
    parser.add_argument("--detector", default="pillars", help="in towns")
    parser.add_argument("--detections", default="ego,1", help="agents, the frame's owner first")
    parser.add_argument("--without", nargs="*", default=["0000"], help="recordings to leave out")
    parser.add_argument("--frames", type=int, default=150, help="of each recording")
    args = parser.parse_args()
    if args.towns:
        recordings = [each for seed in args.towns for each in town(seed, args.frames, args.detector)]
    else:
        folder, agents = RecordingSet(args.recordings), tuple(args.detections.split(","))
        kept = [name for name in folder.sequences if name not in args.without]
        recordings = [folder.load(name, agents) for name in kept]
    weights = fit(recordings, args.frames)
    print(weights.doubt, weights.hearsay, weights.calibration, weights.likelihood, sep="\n")
    report("the same recordings", figures([log_of(each, weights, args.frames) for each in recordings]))
    held_out = []
    for block in np.array_split(np.arange(len(recordings)), FOLDS):
        learned = fit([each for k, each in enumerate(recordings) if k not in block], args.frames)
        held_out += [log_of(recordings[k], learned, args.frames) for k in block]
    report("recordings held out", figures(held_out))
    report(f"{DRAWN} of them, mean of {DRAWS} draws", figures_of_draws(held_out))


class GroupsOfLateFusion(LateFusion):
    """Late fusion that keeps the groups of each agent's frames, and its base frame's poses in their frame."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.groups: dict[str, list[Sequence[Detections]]] = {}
        self.poses: dict[str, list[SE3]] = {}

    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        self.groups.setdefault(agent, []).append(self._latest)
        self.poses.setdefault(agent, []).append(self._states[agent].frame.odom_SE3_base)
        return tracks

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        self._latest = list(groups)
        return super().fuse(groups)


class TruthOfPolicy(Recorder):
    """Keeps the truth around each agent, in its odometry frame, beside what `GroupsOfLateFusion` keeps."""

    def __init__(self) -> None:
        self.truth: dict[str, list[GroundTruth]] = {}

    def on_report(self, episode: Episode) -> None:
        for agent in episode.observations:
            there, pose = episode.infos[agent]["ground_truth"], episode.policy.poses[agent][-1]
            boxes = Boxes3D.from_array(there["box"]).transform(pose)
            self.truth.setdefault(agent, []).append(GroundTruth(there["id"], boxes, there["label"]))


def town(seed: int, frames: int, detector: str) -> list[Recording]:
    """Return a drawn town as each of its agents sees and hears it: boxes and truth in the agent's odometry frame."""
    policy, kept = GroupsOfLateFusion(), TruthOfPolicy()
    options = {"detector": detector, "max_cycles": frames, "expose_ground_truth": True}
    with closing(listening_env("town", policy, options)) as env:
        run_episode(env, policy, (kept,), seed=seed)
    truth = kept.truth
    return [
        Recording(len(truth[agent]), truth[agent], dict(zip(map(str, range(len(groups))), by_sender, strict=True)))
        for agent, heard in policy.groups.items()
        for groups, by_sender in [(heard[-1], list(zip(*heard, strict=True)))]
    ]


def fit(recordings: Sequence[Recording], frames: int) -> Weights:
    """Learn from labelled recordings."""
    doubt, hearsay = (SourceOdds(*_logistic(*each)) for each in _pairs(recordings, frames))
    features, right, chance = _fused(recordings, frames, doubt, hearsay)
    calibration = Calibration(*_logistic(features, right, np.log(np.maximum(chance, 1e-6))))
    policy = CoopFuse(doubt=doubt, hearsay=hearsay, calibration=calibration)
    learned = _logistic(*_reports(recordings, frames, policy))
    likelihood = replace(LIKELIHOOD, **dict(zip(_TRACK_WEIGHTS, learned, strict=True)))
    return Weights(doubt, hearsay, calibration, likelihood)


def log_of(recording: Recording, weights: Weights, frames: int) -> TrackLog:
    """Return the log of coop_fuse with these weights on a recording."""
    evaluator = Evaluator(ON_OBJECT)
    policy = CoopFuse(
        doubt=weights.doubt, hearsay=weights.hearsay, calibration=weights.calibration, likelihood=weights.likelihood
    )
    tracker = policy.make_tracker()
    for frame in range(min(recording.frames, frames)):
        groups = [found[frame] for found in recording.detections.values()]
        evaluator.update(recording.truth[frame], tracker.step(policy.fuse(groups)[0], frame * NS_PER_FRAME))
    return evaluator.log


def report(name: str, values: Floats) -> None:
    """Print the `figures`."""
    print("{}: counted sAMOTA {:.2f}, AMOTA {:.2f}; ignored AMOTA {:.2f}".format(name, *values))


def figures(logs: Sequence[TrackLog]) -> Floats:
    """Return three scores in per cent: sAMOTA and AMOTA with false positives counted, AMOTA with them ignored."""
    counted = summarize(logs)
    return np.array([counted["sAMOTA"], counted["AMOTA"], counted.ignoring_false_positives()["AMOTA"]])


def figures_of_draws(logs: Sequence[TrackLog]) -> Floats:
    """Return the mean of the figures over random draws of the recordings."""
    rng, drawn = stream(0, "draws of recordings"), min(DRAWN, len(logs))
    draws = [figures([logs[k] for k in rng.choice(len(logs), drawn, replace=False)]) for _ in range(DRAWS)]
    mean: Floats = np.mean(draws, axis=0)
    return mean


def _pairs(recordings: Sequence[Recording], frames: int) -> tuple[tuple[Floats, Mask], tuple[Floats, Mask]]:
    """Return features of pairs of boxes of which exactly one is right, and whether it is the other agent's.

    First of objects that both agents detect; then of objects that only the other one detects, paired with the box that
    registration expects of the first agent.
    """
    seen_by_both, seen_by_other = [], []
    for recording in recordings:
        first, *others = recording.detections.values()
        for frame in range(min(recording.frames, frames)):
            truth = recording.truth[frame].boxes.array
            own = _rows(first[frame])
            for other in (_rows(each[frame]) for each in others):
                mine, theirs, new, common, expected = correspond_rows(own, other, MERGE_GATE)
                seen_by_both.append(_one_right(own[mine], other[theirs], truth))
                if common:
                    seen_by_other.append(_one_right(expected, other[new], truth))
    both, only_other = (
        (np.concatenate([features for features, _ in each]), np.concatenate([right for _, right in each]))
        for each in (seen_by_both, seen_by_other)
    )
    return both, only_other


def _rows(found: Detections) -> Floats:
    """Return the valid boxes of an agent as rows (N, 14) of kernels."""
    valid = drop_invalid(found)
    return rows_of_agent(valid.boxes.array, np.ascontiguousarray(valid.score), np.ascontiguousarray(valid.label), 0)


def _one_right(own: Floats, other: Floats, truth: Floats) -> tuple[Floats, Mask]:
    """Select the pairs of which exactly one box is right: features, and whether it is the other agent's."""
    boxes, other_boxes = Boxes3D.from_array(own[:, :BOX]), Boxes3D.from_array(other[:, :BOX])
    own_right, other_right = _right(boxes, truth), _right(other_boxes, truth)
    one = own_right != other_right
    gap_m = other_boxes.bottom - boxes.bottom
    features = pair_features(own[:, SCORE], other[:, SCORE], own[:, AWAY], other[:, AWAY], gap_m)
    return features[one], other_right[one]


def _fused(
    recordings: Sequence[Recording], frames: int, doubt: SourceOdds, hearsay: SourceOdds
) -> tuple[Floats, Mask, Floats]:
    """Return features of all fused boxes, whether each is on an object, and its chance given that an agent is right."""
    features, right, chance = [], [], []
    for recording in recordings:
        for frame in range(min(recording.frames, frames)):
            groups = [found[frame] for found in recording.detections.values()]
            fused = trust_likelier(groups, MERGE_GATE, doubt, hearsay, LEAST_CHANCE)
            features.append(Calibration.features(fused))
            likelier = fused.chance * np.maximum(fused.detections.score, 1e-3)
            right.append(_on_object(fused.detections.boxes.array, likelier, recording.truth[frame].boxes.array))
            chance.append(fused.chance)
    return np.concatenate(features), np.concatenate(right), np.concatenate(chance)


def _reports(recordings: Sequence[Recording], frames: int, policy: CoopFuse) -> tuple[Floats, Mask]:
    """Return features of all tracks in all frames, and whether each is on an object."""
    features, right = [], []
    for recording in recordings:
        tracker = policy.make_tracker()
        for frame in range(min(recording.frames, frames)):
            groups = [found[frame] for found in recording.detections.values()]
            tracker.step(policy.fuse(groups)[0], frame * NS_PER_FRAME)
            tracked = tracker.state.tracked
            features.append(Likelihood.features(tracked))
            right.append(_on_object(tracked.boxes, tracked.score, recording.truth[frame].boxes.array))
    return np.concatenate(features), np.concatenate(right)


def _on_object(boxes: Floats, likelier: Floats, truth: Floats) -> Mask:
    """Return the mask of boxes (N, 7) on an object that no likelier box is on.

    `likelier` (N,) grows with the likelihood. A box that shares its object with a likelier one is a false alarm even if
    it overlaps the object better.
    """
    order = np.argsort(-likelier, kind="stable")
    overlaps = iou_3d(boxes[order], truth)
    in_turn = overlaps - np.arange(len(order))[:, None]  # all pairs of a box precede all pairs of less likely boxes
    rows, _ = greedy(np.where(overlaps >= ON_OBJECT, in_turn, -np.inf), -np.inf)
    on_object = np.zeros(len(boxes), dtype=bool)
    on_object[order[rows]] = True
    return on_object


def _right(boxes: Boxes3D, truth: Floats) -> Mask:
    right: Mask = iou_3d(boxes.array, truth).max(axis=1, initial=0.0) >= ON_OBJECT
    return right


def _logistic(features: Floats, right: Mask, log_factor: Floats | None = None) -> list[float]:
    """Fit a logistic regression of `right`; return its weights, bias first.

    With `log_factor` (N,), the probability is multiplied by a power of the factor, and the power is the last weight. A
    slight ridge on standardised features keeps the weights finite.
    """
    middle, spread = features.mean(axis=0), features.std(axis=0) + 1e-9
    columns = np.column_stack([np.ones(len(features)), (features - middle) / spread])
    factor = np.zeros(len(features)) if log_factor is None else log_factor

    def loss(weights: Floats) -> tuple[float, Floats]:
        odds, power = expit(columns @ weights[:-1]), weights[-1]
        likely = np.clip(np.exp(power * factor) * odds, 1e-9, 1 - 1e-9)
        slope = np.where(right, -1.0, likely / (1 - likely))
        ridge = np.append(0.0, RIDGE * weights[1:-1])
        missed = -np.log(np.where(right, likely, 1 - likely)).mean()
        steepest = columns.T @ (slope * (1 - odds)) / len(right) + ridge
        return float(missed + ridge @ weights[:-1] / 2), np.append(steepest, (slope * factor).mean())

    *fitted, power = minimize(loss, np.append(np.zeros(columns.shape[1]), 1.0), jac=True).x
    weights = np.array(fitted[1:]) / spread
    found = [fitted[0] - weights @ middle, *weights] + ([] if log_factor is None else [power])
    return [round(float(weight), 4) for weight in found]


if __name__ == "__main__":
    main()
