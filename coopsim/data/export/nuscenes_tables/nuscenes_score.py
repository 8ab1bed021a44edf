"""Scores of a tracking result by nuScenes' protocol, with coopsim's own metrics.

The steps are those of the official tools: key frames alone; annotations with at least one return, nearer to the ego
vehicle than their class's range; tracks nearer than that; holes in both filled by interpolation; a track's score is its
mean over frames. Then AMOTA and AMOTP of each class (`coopsim.metrics.clear`), all scenes pooled, and CLEAR at the
level of recall with the highest MOTA. docs/reference/export.md says how far both agree.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.export.nuscenes_tables.nuscenes_names import CATEGORIES, RANGE_M, TRACKED, VERSION
from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.clear import NearSweep, sweep_near
from coopsim.metrics.matching import NEAR_M, find_candidate_pairs
from coopsim.metrics.track_log import FlatLog, TrackLog
from coopsim.types import GroundTruth, Tracks

NAMES = tuple(sorted(set(TRACKED.values())))

_TRACKED_CATEGORY = {category: TRACKED[cls] for cls, category in CATEGORIES.items() if cls in TRACKED}


@dataclass(frozen=True, slots=True)
class _Box:
    """An object or a track in one frame: its name in the tracking task, place (2,) m on the ground, and score."""

    identity: str
    name: str
    place: tuple[float, float]
    score: float = 0.0


Frames = dict[int, list[_Box]]
"""Boxes by time stamp, of one scene."""


def score_results(export: str | Path, tracking: str | Path) -> dict[str, NearSweep]:
    """Score a tracking result on an exported run, by class; classes without an object are left out.

    Args:
        export: folder of the tables.
        tracking: the result file.

    Raises:
        RecordingError: a file is missing or broken, or samples lack in the result.
    """
    logs = [_log(truth, tracks) for truth, tracks in _scenes(Path(export), Path(tracking))]
    found: dict[str, NearSweep] = {}
    for label, name in enumerate(NAMES):
        parts = [log.only(label) for log in logs]
        if any(len(part.truth_id) for part in parts):
            found[name] = sweep_near([part.numbered(part.nearness) for part in parts])
    return found


def as_table(found: Mapping[str, NearSweep]) -> str:
    """Return scores as lines of text: a class each, and the means of AMOTA and AMOTP, as the official tools rank by."""
    lines = [f"{'class':12}{'AMOTA':>7}{'AMOTP':>7}{'MOTA':>7}{'TP':>7}{'FP':>7}{'FN':>7}{'IDS':>6}"]
    for name, sweep in found.items():
        best, line = sweep.best, f"{name:12}{sweep.amota:7.3f}{sweep.amotp:7.3f}"
        if best is not None:
            counts = f"{best.tp - best.ids:7}{best.fp:7}{best.fn:7}{best.ids:6}"
            line += f"{max(best.mota, 0.0):7.3f}{counts}"
        lines.append(line)
    means = [float(np.mean([getattr(sweep, name) for sweep in found.values()] or [np.nan])) for name in _AVERAGES]
    return "\n".join([*lines, f"{'mean':12}{means[0]:7.3f}{means[1]:7.3f}"])


_AVERAGES = ("amota", "amotp")


def _scenes(export: Path, tracking: Path) -> Iterator[tuple[Frames, Frames]]:
    """Yield the objects and the tracks of each scene, filtered and without holes."""
    results = _load(tracking).get("results", {})
    tables = {name: _load(export / VERSION / f"{name}.json") for name in _TABLES}
    stamp = {record["token"]: record["timestamp"] for record in tables["sample"]}
    scene_of = {record["token"]: record["scene_token"] for record in tables["sample"]}
    lacking = [sample for sample in stamp if sample not in results]
    if lacking:
        raise RecordingError(f"{tracking} must have every sample of {export}, lacks {lacking[0]}")
    ego = _ego_places(tables)
    category = {record["token"]: record["name"] for record in tables["category"]}
    category_of = {record["token"]: category[record["category_token"]] for record in tables["instance"]}
    scenes: dict[str, tuple[Frames, Frames]] = {}
    for sample, scene in scene_of.items():
        for frames in scenes.setdefault(scene, ({}, {})):
            frames[stamp[sample]] = []
        for row in results[sample]:
            box = _Box(row["tracking_id"], row["tracking_name"], tuple(row["translation"][:2]), row["tracking_score"])
            if _in_range(box, ego[sample]):
                scenes[scene][1][stamp[sample]].append(box)
    for row in tables["sample_annotation"]:
        name = _TRACKED_CATEGORY.get(category_of[row["instance_token"]])
        if name is None or row["num_lidar_pts"] + row["num_radar_pts"] == 0:
            continue
        box, sample = _Box(row["instance_token"], name, tuple(row["translation"][:2])), row["sample_token"]
        if _in_range(box, ego[sample]):
            scenes[scene_of[sample]][0][stamp[sample]].append(box)
    for objects, tracks in scenes.values():
        yield _without_holes(objects), _without_holes(_with_mean_scores(tracks))


_TABLES = ("sample", "sample_data", "ego_pose", "category", "instance", "sample_annotation")


def _ego_places(tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, tuple[float, float]]:
    """Return where the ego vehicle is in each sample."""
    place = {record["token"]: tuple(record["translation"][:2]) for record in tables["ego_pose"]}
    top = (row for row in tables["sample_data"] if row["is_key_frame"] and "/LIDAR_TOP/" in row["filename"])
    return {row["sample_token"]: place[row["ego_pose_token"]] for row in top}


def _in_range(box: _Box, ego: tuple[float, float]) -> bool:
    return bool(np.hypot(box.place[0] - ego[0], box.place[1] - ego[1]) < RANGE_M[box.name])


def _with_mean_scores(frames: Frames) -> Frames:
    scores: dict[str, list[float]] = defaultdict(list)
    for boxes in frames.values():
        for box in boxes:
            scores[box.identity].append(box.score)
    mean = {identity: float(np.mean(values)) for identity, values in scores.items()}
    return {stamp: [replace(box, score=mean[box.identity]) for box in boxes] for stamp, boxes in frames.items()}


def _without_holes(frames: Frames) -> Frames:
    """Fill the frames between two boxes of one identity.

    The official tools give the earlier box the weight of the time since it, and the later one the rest, which puts a
    box that moves where it would be if time ran backwards through the hole. The same is done here.
    """
    stamps = sorted(frames)
    known: dict[str, list[tuple[int, _Box]]] = defaultdict(list)
    for stamp in stamps:
        for box in frames[stamp]:
            known[box.identity].append((stamp, box))
    filled = {stamp: list(boxes) for stamp, boxes in frames.items()}
    for boxes in known.values():
        for (first, left), (last, right) in pairwise(boxes):
            for stamp in (each for each in stamps if first < each < last):
                weight = (last - stamp) / (last - first)
                x, y = ((1 - weight) * np.array(left.place) + weight * np.array(right.place)).tolist()
                filled[stamp].append(replace(right, place=(x, y)))
    return filled


def _log(objects: Frames, tracks: Frames) -> FlatLog:
    """Return a scene's log with the pairs of one name whose centres are less than 2 m apart."""
    log, numbers = TrackLog(1.0), dict[str, int]()
    for stamp in sorted(objects):
        true, found = objects[stamp], tracks[stamp]
        truth_label, track_label = (
            np.array([NAMES.index(box.name) for box in each], np.int64) for each in (true, found)
        )
        truth_box, track_box = (_flat_boxes(each) for each in (true, found))
        pairs = find_candidate_pairs(truth_box.array, truth_label, track_box.array, track_label)
        truth_id, track_id = (
            np.array([numbers.setdefault(box.identity, len(numbers)) for box in each], np.int64)
            for each in (true, found)
        )
        score = np.array([box.score for box in found], np.float64)
        log.append(
            GroundTruth(truth_id, truth_box, truth_label),
            np.ones(len(true), np.bool_),
            Tracks(track_id, track_box, np.zeros((len(found), 2)), score, track_label),
            np.ones(len(found), np.bool_),
            pairs,
        )
    return log.flat()


def _flat_boxes(boxes: Sequence[_Box]) -> Boxes3D:
    """Return boxes of which only the places mean anything: smaller than any distance at which two are matched."""
    rows = np.full((len(boxes), 7), 1e-3 * NEAR_M)
    rows[:, :2] = np.array([box.place for box in boxes]).reshape(-1, 2)
    return Boxes3D.from_array(rows)


def _load(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path} cannot be read: {error}") from error
