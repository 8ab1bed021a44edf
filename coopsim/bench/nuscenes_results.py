"""Results of a policy on an exported run, as the JSON files that nuScenes' official tools score.

The episodes of the export are simulated again, with what the policy needs: noise of sensors, poses and messages has
streams of its own, so the world is the exported one, frame by frame.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.catalog import PolicySpec, refuse_writing
from coopsim.data.export.export_card import CARD, DONE, read_card
from coopsim.data.export.export_format import LineFile, make_export_format
from coopsim.data.export.export_frame import ExportPlan
from coopsim.data.export.nuscenes_format import NuscenesFormat
from coopsim.data.export.nuscenes_records import (
    CATEGORIES,
    RANGE_M,
    TRACKED,
    VERSION,
    attribute_name,
    quaternions,
    sample_token,
    scene_name,
)
from coopsim.data.export.record_parts import as_line
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.metrics.clear import NearSweep, sweep_near
from coopsim.metrics.matching import NEAR_M, find_candidate_pairs
from coopsim.metrics.track_log import FlatLog, TrackLog
from coopsim.provided import listening_env
from coopsim.support.files import locked, make_folder
from coopsim.support.user_code import code_in
from coopsim.types import GroundTruth, Ints, ObjectClass, Tracks

if TYPE_CHECKING:
    from coopsim.envs.parallel import CooperativeEnv


TRACKING, DETECTION = "tracking.json", "detection.json"

MOST_BOXES = 500
"""The official tools refuse more in one sample; the surest are kept."""


def write_results(
    export: str | Path,
    policy: str,
    folder: str | Path,
    *,
    progress: Callable[[int], object] | None = None,
    **options: Any,
) -> Path:
    """Run a policy on the episodes of a nuScenes export, and write what it reports as tracks and as detections.

    Args:
        export: folder that `coopsim export nuscenes` wrote; nothing is written into it.
        policy: spec of a policy, as in `coopsim bench`.
        folder: is made; gets `tracking.json` and `detection.json`.
        progress: called with the number of frames that are done.
        **options: options of the environment, beyond those of the export, as `detector`, `loss` or `latency_s`.

    Raises:
        CoopsimError: the folder is no such export, or the policy or an option is not accepted.
    """
    plan, writer = read_plan(Path(export))
    steps = {} if "playback" in plan.options else {"max_cycles": max(plan.frames - 1, 1)}
    given = {**steps, **plan.options, **options, "expose_ground_truth": True}
    runner = PolicySpec.parse(policy).make()
    make_folder(Path(folder))
    with (
        closing(listening_env(plan.environment, runner, given)) as env,
        locked(Path(folder)),
        _ResultFile(Path(folder) / TRACKING, env) as tracking,
        _ResultFile(Path(folder) / DETECTION, env) as detection,
    ):
        if given.get("control", "traffic") != "traffic":
            raise InvalidValueError("control must be 'traffic': cars that a policy drives go elsewhere than exported")
        every = writer.key_every(next(iter(env.agent_specs.values())).dt_s)
        for seed in plan.seeds:
            kept = _ResultRecorder(writer, plan.episode_name(seed), every, tracking, detection, progress)
            run_episode(env, runner, (kept,), seed=seed, most_steps=plan.frames - 1, last_report=True)
    return Path(folder)


class _ResultRecorder(Recorder):
    """Writes what is reported in key frames, as tracks and as detections."""

    def __init__(
        self,
        writer: NuscenesFormat,
        name: str,
        every: int,
        tracking: _ResultFile,
        detection: _ResultFile,
        progress: Callable[[int], object] | None,
    ) -> None:
        self._writer, self._name, self._every = writer, name, every
        self._tracking, self._detection, self._progress = tracking, detection, progress

    def on_report(self, episode: Episode) -> None:
        if episode.steps % self._every == 0:
            for agent in filter(self._writer.exports, episode.observations):
                sample = sample_token(scene_name(self._name, agent), episode.steps)
                x_to_yaw = episode.infos[agent]["true_pose"]
                world_SE3_base = SE3.from_xyz_yaw(x_to_yaw[:3], float(x_to_yaw[3]))
                reported = episode.tracks[agent].transform(world_SE3_base)
                self._tracking.add(sample, _tracked(sample, reported))
                self._detection.add(sample, _as_detections(sample, reported))
        if self._progress is not None:
            self._progress(1)


def read_plan(export: Path) -> tuple[ExportPlan, NuscenesFormat]:
    """Read what an export of nuScenes' tables was asked for.

    Raises:
        CoopsimError: the folder is no finished export, or one of another format.
    """
    card = read_card(export)
    writer = make_export_format(card["format"])
    if not isinstance(writer, NuscenesFormat):
        raise InvalidValueError(f"{export} must be an export as nuscenes, got one as {card['format']}")
    if card["state"] != DONE:
        raise InvalidValueError(f"{export} must be a finished export: run the command that made it again")
    refuse_writing(card["options"], f"{export / CARD}: options")
    if (code := code_in(card["options"])) is not None:
        raise InvalidValueError(f"{export / CARD}: options must not name code to run, got {code!r}")
    return ExportPlan(
        card["format"], card["environment"], tuple(card["seeds"]), card["frames"], card["options"]
    ), writer


class _ResultFile:
    """A result file, of which one sample's boxes are held in memory; an error in its context leaves no file behind."""

    def __init__(self, path: Path, env: CooperativeEnv) -> None:
        cameras = any(spec.cameras for spec in env.agent_specs.values())
        lidars = any(spec.lidars for spec in env.agent_specs.values())
        meta = {"use_camera": cameras, "use_lidar": lidars, "use_radar": False, "use_map": False, "use_external": True}
        self._file, self._first = LineFile(path), True
        self._file.append(f'{{"meta":{as_line(meta)},"results":{{')

    def add(self, sample: str, boxes: Iterable[Mapping[str, Any]]) -> None:
        comma = "" if self._first else ","
        self._file.append(f'{comma}"{sample}":[{",".join(map(as_line, boxes))}]')
        self._first = False

    def __enter__(self) -> _ResultFile:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is not None:
            self._file.discard()
            return
        self._file.append("}}")
        self._file.close()


def _tracked(sample: str, tracks: Tracks) -> Iterable[dict[str, Any]]:
    rows = _kept(tracks.label, tracks.score)
    for row, box in zip(rows, _boxes(sample, tracks.boxes[rows], tracks.velocity[rows]), strict=True):
        name = TRACKED[ObjectClass(tracks.label[row])]
        score = float(tracks.score[row])
        yield {**box, "tracking_id": str(tracks.id[row]), "tracking_name": name, "tracking_score": score}


def _as_detections(sample: str, tracks: Tracks) -> Iterable[dict[str, Any]]:
    rows = _kept(tracks.label, tracks.score)
    speed = np.linalg.norm(tracks.velocity, axis=1)
    for row, box in zip(rows, _boxes(sample, tracks.boxes[rows], tracks.velocity[rows]), strict=True):
        name, attribute = TRACKED[ObjectClass(tracks.label[row])], attribute_name(tracks.label[row], speed[row])
        score = float(tracks.score[row])
        yield {**box, "detection_name": name, "detection_score": score, "attribute_name": attribute}


def _kept(label: Ints, score: Floats) -> Ints:
    """Return the rows of objects that the tasks have, at most `MOST_BOXES`, the surest first where there are more."""
    rows = np.flatnonzero(np.isin(label, [int(cls) for cls in TRACKED]))
    return rows if len(rows) <= MOST_BOXES else rows[np.argsort(-score[rows], kind="stable")[:MOST_BOXES]]


def _boxes(sample: str, boxes: Boxes3D, velocity: Floats) -> Iterable[dict[str, Any]]:
    """Yield the fields that tracks and detections share; sizes are width, length, height."""
    sizes, turns = boxes.size[:, [1, 0, 2]], quaternions(boxes.yaw)
    for row in range(len(boxes)):
        yield {
            "sample_token": sample,
            "translation": boxes.center[row].tolist(),
            "size": sizes[row].tolist(),
            "rotation": turns[row].tolist(),
            "velocity": velocity[row].tolist(),
        }


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
