"""Results of a policy on an exported run, as the JSON files that nuScenes' official tools score.

The episodes of the export are simulated again, with what the policy needs: noise of sensors, poses and messages has
streams of its own, so the world is the exported one, frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.evaluate import listening_env
from coopsim.catalog import PolicySpec, refuse_writing
from coopsim.data.export.export_card import CARD, DONE, read_card
from coopsim.data.export.export_format import make_export_format
from coopsim.data.export.export_plan import ExportPlan
from coopsim.data.export.line_file import LineFile
from coopsim.data.export.nuscenes_tables.annotation_records import quaternions
from coopsim.data.export.nuscenes_tables.nuscenes_format import NuscenesFormat
from coopsim.data.export.nuscenes_tables.nuscenes_names import TRACKED, attribute_name, sample_token, scene_name
from coopsim.data.export.record_parts import as_line
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.files import locked, make_folder
from coopsim.support.rng import derived_seed
from coopsim.types import Ints, ObjectClass, Tracks
from coopsim.wire.actions import unpack_actions

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
        policy: as in `coopsim bench`.
        folder: is made; gets `tracking.json` and `detection.json`.
        progress: called with the number of frames that are done.
        **options: of the environment, beyond those of the export, as `detector`, `loss` or `latency_s`.

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
        if any(spec.drives for spec in env.agent_specs.values()):
            raise InvalidValueError("control must be 'traffic': cars that a policy drives go elsewhere than exported")
        every = writer.key_every(next(iter(env.agent_specs.values())).dt_s)
        for seed in plan.seeds:
            observations, infos = env.reset(seed=seed)
            runner.reset(env.agent_specs, seed=derived_seed(seed, "policy"))
            for index in range(plan.frames):
                actions = runner.act(observations)
                if index % every == 0:
                    # Not `env.agents`: in the last frame of an episode nobody is left to act.
                    tracks, _ = unpack_actions(list(observations), actions, [])
                    for agent in filter(writer.exports, observations):
                        sample = sample_token(scene_name(plan.episode_name(seed), agent), index)
                        x_to_yaw = infos[agent]["true_pose"]
                        world_SE3_base = SE3.from_xyz_yaw(x_to_yaw[:3], float(x_to_yaw[3]))
                        reported = tracks[agent].transform(world_SE3_base)
                        tracking.add(sample, _tracked(sample, reported))
                        detection.add(sample, _as_detections(sample, reported))
                if progress is not None:
                    progress(1)
                if index + 1 < plan.frames:
                    observations, _, _, _, infos = env.step(actions)
    return Path(folder)


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
