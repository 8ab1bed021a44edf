"""Compare V2V4Real with its twin: the same road users, sensed by our LiDAR model and a detector fitted elsewhere.

    python scripts/measure_twin.py path/to/v2v4real --out twin

What is measured is kept in OUT, and a second run goes on from there. The detector, and the error between both cars'
poses, are fitted to the twins of the training recordings without 0000, which is one of the validation set. Nothing is
fitted to the validation recordings; trackers get detections alone, of either world. See docs/results/twin.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from detector_matches import AGENTS, Matches
from fit_detector import WITHOUT, fit, to_yaml
from measure_pose_residual import common_objects, residuals, spread
from rank_policies import DRAWS, METRICS, on_recordings
from scipy.stats import kendalltau, spearmanr
from tabulate import tabulate
from tqdm import tqdm
from twin_found import EDGES_M, Found
from twin_worlds import Labels, TwinWorld, sense

from coopsim.data.recorded_path import in_world
from coopsim.data.recording_set import RecordingSet
from coopsim.detection.presets import read_config
from coopsim.detection.simulated.correlated import CorrelatedDetector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.rng import stream
from coopsim.types import Detections, Ints

POLICIES = (
    "no_fusion", "late_fusion", "sequential_kf", "coop_fuse", "track_to_track", "dino_codt_tracking",
    "yoloo_geometry", "graph_lap_aos", "graph_lap_tsa", "vic_fscm_association(score_decay=1)",
)  # fmt: skip
DETECTOR, POSES = "detector.yaml", "poses.json"
"""Files of what is fitted."""

FITTED_FRAMES = 120
"""Frames of each training recording that are fitted to, its first 12 s: short and long ones count alike."""

REGION_M = np.array([98.5, 38.6])
"""Half the region around the first car in which the training recordings have boxes of either car."""

STILL_FRAMES = 2
"""Standing labels above which a frame's pose is said to be held."""

RANGE_HEADS = [
    f"{what}, {car}, {world}" for what in ("recall", "false") for car in AGENTS for world in ("real", "twin")
]
SEEN = ("both", "first alone", "second alone", "neither")


def main() -> None:
    """Read the arguments, and go through all steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, help="folder with train/ and val/")
    parser.add_argument("--out", type=Path, required=True, help="folder for what is measured")
    parser.add_argument("--check", action="store_true", help="compare one draw on training recordings, no trackers")
    parser.add_argument("--draws", type=int, default=3, help="draws of the twin: misses, errors, false boxes, poses")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if not (given.out / POSES).is_file():
        fit_twin(worlds(given.recordings / "train", WITHOUT, FITTED_FRAMES), given.out)
    name, real = ("train", given.recordings / "train") if given.check else ("val", given.recordings / "val")
    tested = worlds(real, WITHOUT if given.check else (), FITTED_FRAMES if given.check else None)
    draws = range(1 if given.check else given.draws)
    folders = [write_twin(tested, given.out / f"{name}_{seed}", given.out, seed) for seed in draws]
    print(exactness_table(tested), "\n")
    print(detection_tables(real, folders, tested))
    if not given.check:
        drawn = [scores(folder, given.out, folder.name) for folder in folders]
        print(ranking_tables(scores(real, given.out, "real"), np.mean(drawn, axis=0)))


def worlds(folder: Path, leave_out: tuple[str, ...] = (), most: int | None = None) -> dict[str, TwinWorld]:
    """Return the worlds of a folder's recordings by name, of the first `most` frames of each."""
    recordings = RecordingSet(folder, "v2v4real")
    kept = [each for each in recordings.sequences if each not in leave_out]
    return {each: TwinWorld.of(recordings.load(each, AGENTS).first(most)) for each in tqdm(kept, "worlds")}


def fit_twin(train: Mapping[str, TwinWorld], out: Path) -> None:
    """Fit the detector, and the error between the cars' poses, to training recordings; write both."""
    matches = {name: Matches() for name in AGENTS}
    for episode, (name, world) in enumerate(tqdm(train.items(), "sensing")):
        add_matches(matches, episode, world, out / "logs" / f"train_{name}")
    detector = to_yaml(fit(*(each.close() for each in matches.values())))
    (out / DETECTOR).write_text(detector, encoding="utf-8")
    turn_rad = float(np.radians(residuals(common_objects(world.recording for world in train.values()))[1]))
    errors = pose_errors([world.labels for world in train.values()], turn_rad)
    (out / POSES).write_text(json.dumps(errors), encoding="utf-8")


def add_matches(matches: dict[str, Matches], episode: int, world: TwinWorld, log: Path) -> None:
    """Add the first car's boxes, with the returns that its twin has, and the second car's boxes beside the same."""
    labels = world.labels
    for notes, frame in twin_frames(world, log, SimulatedDetector(), 0):
        rows = labels.objects[labels.frame[labels.objects] == frame]
        returns, actors, _ = notes[0]
        seen = np.append(returns, 0)[nearest(labels.boxes.center[rows, :2], actors.boxes.center[:, :2])]
        for name, each in matches.items():
            each.add(episode, frame, labels.id[rows], labels.boxes[rows], seen, world.recording.detections[name][frame])


def nearest(place: Floats, others: Floats, within_m: float = 0.3) -> Ints:
    """Return the row (N,) of the other place that is nearest to each; -1: none is within reach."""
    away = np.linalg.norm(place[:, None] - others, axis=2)
    if not len(others):
        return np.full(len(place), -1)
    return np.where(away.min(axis=1) < within_m, away.argmin(axis=1), -1)


def twin_frames(world: TwinWorld, log: Path, detector: Any, seed: int) -> Iterator[tuple[list[Any], int]]:
    """Play a twin; yield the notes of both cars, and the frame."""
    log.parent.mkdir(parents=True, exist_ok=True)
    for number, frames in enumerate(world.parts):
        path = log.with_name(f"{log.name}_{number}.csv")
        world.write_log(path, frames)
        place = world.path.pose[frames, :2]
        middle = np.round((place.min(axis=0) + place.max(axis=0)) / 2)
        watch = sense(path, middle.tolist(), len(frames), detector, 1000 * seed + number)
        for notes, frame in zip(zip(*watch.notes.values(), strict=True), frames.tolist(), strict=True):
            yield list(notes), frame


def pose_errors(labels: list[Labels], turn_rad: float) -> dict[str, list[float]]:
    """Return how the second car's labels lie off, by its labels of the first car, which is at the origin.

    Headings of labels err by more than the poses do, so the spread of turns is given.

    Returns:
        x, y (m) and heading (rad): mean and standard deviation over recordings of each one's median, the robust
        standard deviation within recordings, and the correlation of what is within after a frame.
    """
    middles, within, first, second = [], [], [], []
    for each in labels:
        rows = np.flatnonzero(each.own)
        if len(rows) < 2:
            continue
        at_m = each.boxes.center[rows, :2]
        middles.append(np.median(at_m, axis=0))
        within.append(at_m - middles[-1])
        follows = np.diff(each.frame[rows]) == 1
        first.append(within[-1][:-1][follows])
        second.append(within[-1][1:][follows])
    before, after = np.concatenate(first), np.concatenate(second)
    kept = 1 - spread(after - before) ** 2 / (2 * spread(before) ** 2)
    parts = {
        "mean": [*np.mean(middles, axis=0), 0.0],
        "between": [*np.std(middles, axis=0), 0.0],
        "within": [*spread(np.concatenate(within)), turn_rad],
        "kept": [*kept, kept[0]],
    }
    return {name: [float(each) for each in part] for name, part in parts.items()}


def draw_pose_errors(errors: Mapping[str, list[float]], frames: int, seed: int, name: str) -> Floats:
    """Return the error (F, 3) of the second car's pose in the first one's frame, x, y m and heading rad."""
    rng = stream(seed, "poses", name)
    mean, between, within, kept = (np.array(errors[part]) for part in ("mean", "between", "within", "kept"))
    drawn = within * rng.standard_normal((frames, 3))
    for k in range(1, frames):
        drawn[k] = kept * drawn[k - 1] + np.sqrt(1 - kept**2) * drawn[k]
    moved: Floats = mean + between * rng.standard_normal(3) + drawn
    return moved


def write_twin(twins: Mapping[str, TwinWorld], folder: Path, fitted: Path, seed: int) -> Path:
    """Write the twins as a recording set, in the recordings' format and frame, and return the folder.

    `fitted` is the folder of what `fit_twin` writes.
    """
    detector = CorrelatedDetector(read_config(fitted / DETECTOR))
    poses = json.loads((fitted / POSES).read_text(encoding="utf-8"))
    for number, (name, world) in enumerate(twins.items()):
        done = folder / "labels" / f"{name}.txt"
        if done.is_file():
            continue
        off = draw_pose_errors(poses, world.recording.frames, seed, name)
        found: dict[str, list[str]] = {agent: [] for agent in AGENTS}
        log = folder / "logs" / name
        for notes, frame in twin_frames(world, log, detector, 100 * seed + number):
            second = world.second
            pose = np.append(second.place[frame], second.heading[frame])
            for agent, (_, _, boxes) in zip(AGENTS, notes, strict=True):
                if agent == AGENTS[1]:
                    boxes = Detections(shifted(placed(boxes.boxes, pose), pose, off[frame]), boxes.score, boxes.label)
                found[agent] += detection_lines(frame, boxes)
        for agent, lines in found.items():
            write_lines(folder / "detections" / agent / f"{name}.txt", lines)
        write_lines(done, label_lines(world, off))
    return folder


def placed(boxes: Boxes3D, pose: Floats) -> Boxes3D:
    """Return boxes in the frame in which their own frame has a pose (3,)."""
    at = in_world(boxes.center[:, :2], np.tile(pose, (len(boxes), 1)))
    return Boxes3D(np.column_stack([at, boxes.center[:, 2]]), boxes.size, wrap_angle(boxes.yaw + pose[2]))


def shifted(boxes: Boxes3D, pose: Floats, off: Floats) -> Boxes3D:
    """Return boxes as they lie if the pose (3,) of the car that saw them is off by (3,)."""
    center = boxes.center - np.append(pose[:2], 0.0)
    return placed(Boxes3D(center, boxes.size, boxes.yaw), np.append(pose[:2] + off[:2], off[2]))


def label_lines(world: TwinWorld, off: Floats) -> list[str]:
    """Return the lines of the twin's labels: the recording's on flat ground, those of the second car off as it is."""
    labels, second, lines = world.labels, world.second, []
    size = labels.size.copy()
    size[world.labels.own] = world.car_size_m(0)
    size[world.is_second(np.arange(len(size)))] = world.car_size_m(1)
    for k, frame in enumerate(labels.frame.tolist()):
        at, yaw = labels.boxes.center[labels.of[k], :2], labels.boxes.yaw[labels.of[k]]
        if labels.own[k]:
            at, yaw = np.zeros(2), 0.0
        box = Boxes3D(np.append(at, size[k, 2] / 2)[None], size[k][None], np.array([yaw]))
        if labels.late[k]:
            box = shifted(box, np.append(second.place[frame], second.heading[frame]), off[frame])
        lines.append(f"{frame} {labels.id[k]} Car 0 0 0 0 0 0 0 " + " ".join(numbers(box)[0]))
    return lines


def detection_lines(frame: int, found: Detections) -> list[str]:
    """Return the lines of the boxes within the region."""
    inside = (np.abs(found.boxes.center[:, :2]) <= REGION_M).all(axis=1)
    rows = zip(found.score[inside].tolist(), numbers(found.boxes[inside]), strict=True)
    return [",".join([str(frame), "2", "0", "0", "0", "0", f"{score:.5f}", *row, "0"]) for score, row in rows]


def numbers(boxes: Boxes3D) -> list[list[str]]:
    """Return h, w, l, x, z, y and heading of each box, as the recordings' columns have them."""
    return [[f"{each:.4f}" for each in row] for row in boxes.array[:, [5, 4, 3, 0, 2, 1, 6]].tolist()]


def write_lines(path: Path, lines: list[str]) -> None:
    """Write a file, and its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def exactness_table(twins: Mapping[str, TwinWorld]) -> str:
    """Format how exact recovered paths are: by standing objects, by those of the other half, and by both halves."""
    rows = []
    for name, world in twins.items():
        (one, over_one), (two, over_two) = world.halves()
        apart, second = one.pose[-1] - two.pose[-1], world.second
        second_apart = seconds_apart(one.pose, two.pose)
        standing = np.bincount(world.seen.frame[world.path.standing], minlength=world.recording.frames)
        rows.append(
            [
                name,
                world.recording.frames,
                f"{np.mean(standing > STILL_FRAMES):.2f}",
                spread_cm(world.path.residual_m),
                spread_cm(np.concatenate([over_one, over_two])),
                *(
                    (
                        f"{100 * second_apart[0]:.0f} cm, {np.degrees(second_apart[1]):.2f}",
                        f"{np.hypot(*apart[:2]):.1f} m, {np.degrees(abs(apart[2])):.1f}",
                    )
                    if standing.sum() > world.recording.frames
                    else ("-", "-")
                ),
                f"{np.mean(second.label >= 0):.2f}",
                f"{second.boxed.mean():.2f}",
                f"{second.score:.2f}",
            ]
        )
    heads = [
        "recording",
        "frames",
        "held",
        "residual",
        "other half",
        "apart in 1 s",
        "at the end",
        "labelled",
        "boxed",
        "score",
    ]
    return tabulate(rows, heads, tablefmt="github", disable_numparse=True)


def seconds_apart(one: Floats, two: Floats) -> tuple[float, float]:
    """Return how far two paths (F, 3) differ in where the car is after each second, m and rad: medians."""
    moved = []
    for pose in (one, two):
        there = pose[10:] - pose[:-10]
        turned = np.column_stack([np.zeros((len(there), 2)), -pose[:-10, 2]])
        moved.append(np.column_stack([in_world(there[:, :2], turned), there[:, 2]]))
    off = moved[0] - moved[1]
    return float(np.median(np.hypot(*off[:, :2].T))), float(np.median(np.abs(off[:, 2])))


def spread_cm(residual_m: Floats) -> str:
    """Format the robust standard deviation an axis, and the 90th percentile of distances, cm."""
    kept = residual_m[np.isfinite(residual_m[:, 0])] * 100
    if not len(kept):
        return "-"
    return f"{np.median(np.abs(kept)) / 0.6745:.1f}, {np.quantile(np.hypot(*kept.T), 0.9):.0f}"


def detection_tables(real: Path, folders: list[Path], twins: Mapping[str, TwinWorld]) -> str:
    """Format recall and false boxes by range, who found what, and AP, of the recordings and of the mean twin."""
    there, draws = Found.of(real, twins), [Found.of(folder, twins) for folder in folders]
    frames = sum(world.recording.frames for world in twins.values())
    rows = []
    for k, (low, high) in enumerate(itertools.pairwise(EDGES_M)):
        row = [f"{low:.0f} to {high:.0f}", int(np.histogram(there.range_m, EDGES_M)[0][k])]
        for car in (0, 1):
            row += [f"{there.recall(car)[k]:.2f}", f"{np.mean([each.recall(car)[k] for each in draws]):.2f}"]
        for car in (0, 1):
            counts = [np.histogram(each.false[car][:, 1], EDGES_M)[0][k] / frames for each in (there, *draws)]
            row += [f"{counts[0]:.2f}", f"{np.mean(counts[1:]):.2f}"]
        rows.append(row)
    parts = [tabulate(rows, ["range, m", "labels", *RANGE_HEADS], tablefmt="github", disable_numparse=True)]
    mean = np.mean([each.shares() for each in draws], axis=0)
    parts.append(tabulate(zip(SEEN, there.shares(), mean, strict=True), ["found by", "real", "twin"], "github", ".2f"))
    scored = [
        [agent, there.precision[k], np.mean([each.precision[k] for each in draws])] for k, agent in enumerate(AGENTS)
    ]
    parts.append(tabulate(scored, ["AP@0.5", "real", "twin"], "github", ".3f"))
    return "\n\n".join(parts) + "\n"


def scores(folder: Path, out: Path, name: str) -> Floats:
    """Return the scores (P, R, M) of policies on the recordings of a folder, kept in OUT."""
    kept = out / f"scores_{name}.json"
    known = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    for policy in tqdm([each for each in POLICIES if each not in known], name):
        known[policy] = on_recordings(folder, policy, AGENTS).tolist()
        kept.write_text(json.dumps(known), encoding="utf-8")
    return np.array([known[policy] for policy in POLICIES])


def ranking_tables(real: Floats, twin: Floats) -> str:
    """Format scores (P, R, M), and rank correlations of means over recordings, which are drawn together."""
    rows = [
        [
            policy,
            *(f"{each[k, :, m].mean():.1f} ({ranks(each[:, :, m])[k]})" for m in range(2) for each in (real, twin)),
        ]
        for k, policy in enumerate(POLICIES)
    ]
    heads = ["policy", *(f"{metric}, {world}" for metric in METRICS for world in ("real", "twin"))]
    rng, lines = stream(0, "bootstrap"), []
    drawn = rng.integers(real.shape[1], size=(DRAWS, real.shape[1]))
    for m, metric in enumerate(METRICS):
        line = [metric]
        for statistic in (spearmanr, kendalltau):
            at, *draws = (
                statistic(real[:, rows_, m].mean(axis=1), twin[:, rows_, m].mean(axis=1)).statistic
                for rows_ in (np.arange(real.shape[1]), *drawn)
            )
            line.append("{:.2f} ({:.2f} to {:.2f})".format(at, *np.quantile(draws, [0.025, 0.975])))
        lines.append(line)
    heads_of = ["metric", "Spearman's rho (95 %)", "Kendall's tau (95 %)"]
    return tabulate(rows, heads, "github") + "\n\n" + tabulate(lines, heads_of, "github")


def ranks(scores_: Floats) -> Ints:
    """Return the ranks (P,) of mean scores over recordings (P, R), the best 1."""
    placed_: Ints = (-scores_.mean(axis=1)).argsort().argsort() + 1
    return placed_


if __name__ == "__main__":
    main()
