"""A scene's annotations and instances, of which only the last key frame's are held in memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.data.export.export_frame import ExportFrame
from coopsim.data.export.nuscenes_tables.nuscenes_names import (
    CATEGORIES,
    attribute_tokens,
    sample_token,
    visibility_token,
)
from coopsim.data.export.record_parts import token
from coopsim.data.export.seen_share import FREE_SHARE, seen_shares
from coopsim.geometry.se3 import Floats
from coopsim.types import ObjectClass

Records = dict[str, list[dict[str, Any]]]


class AnnotationRecords:
    """The annotations of one scene, linked by instance.

    An object is annotated in every key frame in which it exists, wherever it is. If it ends and a later one has its
    number, that is another instance.

    Args:
        scene: name of the scene.
        column: number of the agent.
        own_points: count the points of this agent's LiDARs alone.
    """

    def __init__(self, scene: str, column: int, *, own_points: bool) -> None:
        self._scene, self._column, self._own_points = scene, column, own_points
        self._waiting: dict[int, dict[str, Any]] = {}
        self._instances: dict[int, dict[str, Any]] = {}

    def add(self, frame: ExportFrame) -> Records:
        """Take a key frame. Return the records that are complete by it."""
        fresh = self._annotations(frame)
        for number, record in fresh.items():
            last = self._waiting.get(number)
            if last is not None:
                last["next"], record["prev"] = record["token"], last["token"]
            instance = self._instances.setdefault(
                number,
                {
                    "token": token(self._scene, "instance", number, frame.index),
                    "category_token": token("category", CATEGORIES[ObjectClass(record["label"])]),
                    "nbr_annotations": 0,
                    "first_annotation_token": record["token"],
                    "last_annotation_token": "",
                },
            )
            del record["label"]
            record["instance_token"] = instance["token"]
            instance["nbr_annotations"] += 1
            instance["last_annotation_token"] = record["token"]
        ended = [self._instances.pop(number) for number in [*self._instances] if number not in fresh]
        complete = list(self._waiting.values())
        self._waiting = fresh
        return {"sample_annotation": complete, "instance": ended}

    def end(self) -> Records:
        """Return the records that were waiting for another key frame."""
        return {"sample_annotation": list(self._waiting.values()), "instance": list(self._instances.values())}

    def _annotations(self, frame: ExportFrame) -> dict[int, dict[str, Any]]:
        objects = frame.objects
        own_returns = frame.returns[:, self._column]
        returns = own_returns if self._own_points else frame.returns.sum(axis=1)
        visible = np.minimum(seen_shares(frame, self._column) / FREE_SHARE, 1.0)
        speed = np.linalg.norm(frame.velocity, axis=1)
        places, sizes, turns = (
            objects.boxes.center.round(6),
            objects.boxes.size[:, [1, 0, 2]],
            quaternions(objects.boxes.yaw),
        )
        found: dict[int, dict[str, Any]] = {}
        for row, number in enumerate(objects.id.tolist()):
            if number == frame.agents[self._column].body.actor_id:
                continue
            found[number] = {
                "token": token(self._scene, "annotation", frame.index, number),
                "sample_token": sample_token(self._scene, frame.index),
                "instance_token": "",
                "visibility_token": visibility_token(float(visible[row])),
                "attribute_tokens": attribute_tokens(int(objects.label[row]), float(speed[row])),
                "translation": places[row].tolist(),
                "size": sizes[row].tolist(),
                "rotation": turns[row].tolist(),
                "prev": "",
                "next": "",
                "num_lidar_pts": int(returns[row]),
                "num_radar_pts": 0,
                "num_own_lidar_pts": int(own_returns[row]),
                "label": int(objects.label[row]),
            }
        return found


def quaternions(yaw_rad: Floats) -> Floats:
    """Return w, x, y, z (N, 4) of turns (N,) about z."""
    half, zero = yaw_rad / 2, np.zeros(len(yaw_rad))
    turns: Floats = np.column_stack([np.cos(half), zero, zero, np.sin(half)]).round(9)
    return turns
