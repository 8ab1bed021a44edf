"""The truth of a frame as it stands in the agents' infos, for training and export.

| key of `infos[agent]` | meaning |
|---|---|
| `ground_truth` | all objects but the agent itself, see below |
| `true_pose` | (4,): the agent's true x, y, z m and heading rad in the world frame |
| `actor_id` | the agent's own id among the actors; None for an agent that is no actor, as a roadside unit |
| `instances` | by LiDAR, (P,): id of the actor behind each point, 0 for the scenery, -1 for clutter |
| `segmentation` | by camera: `instance` and `semantic` (H, W), where `camera_modes` has them |
| `visibility` | how well the agent's LiDARs see each actor (`Visibility`), with `expose_visibility` |
| `pixel_visibility` | how well its cameras do (`PixelVisibility`), with `expose_visibility` and the mode `instance` |

| key of `ground_truth` | meaning |
|---|---|
| `id`, `label` | (N,) |
| `box` | (N, 7): x, y, z, l, w, h, yaw in the agent's base frame |
| `velocity` | (N, 2) m/s over ground, in the axes of the agent's base frame |
| `returns` | (N, A) number of LiDAR returns of each agent, in the order of `env.possible_agents` |
| `seen_by` | (N, A) whether there is any |
| `visible_to` | (N,): 0 the agent itself has returns, 1 only others have, 2 no agent has |
| `in_region` | (N,) whether the object is in the evaluation region |
| `counts` | (N,) whether the object counts in the score |

A recording of detections in text files has no `velocity`, `returns`, `seen_by` and `visible_to`.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.envs.frames import AgentFrame, Frame
from coopsim.sensors.visibility.lidar_visibility import Visibility
from coopsim.sensors.visibility.pixel_visibility import PixelVisibility
from coopsim.types import GroundTruth, stack_xyz_yaw
from coopsim.types.sensing import TRUTH_MODES
from coopsim.wire.observation_format import pack_image


def truth_infos(frame: Frame, *, visibility: bool) -> dict[str, dict[str, Any]]:
    """Return the truth of a frame by agent; `visibility` adds the part that takes time."""
    infos = {name: _truth_info(agent) for name, agent in frame.agents.items()}
    if visibility:
        for name, seen in frame.probe.visibility().items():
            infos[name]["visibility"] = _columns(seen)
        for name, shown in frame.probe.pixel_visibility().items():
            infos[name]["pixel_visibility"] = _columns(shown)
    return infos


def _truth_info(agent: AgentFrame) -> dict[str, Any]:
    return {
        "ground_truth": _object_columns(agent.truth),
        "true_pose": stack_xyz_yaw(agent.body.world_SE3_base),
        "actor_id": agent.body.actor_id,
        "instances": dict(agent.instances),
        "segmentation": {name: pack_image(image, TRUTH_MODES) for name, image in agent.segmentation.items()},
    }


def _object_columns(truth: GroundTruth) -> dict[str, NDArray[Any]]:
    # Copies, because the originals are what the agent is scored against.
    everywhere = np.ones(len(truth), np.bool_)
    columns: dict[str, NDArray[Any] | None] = {
        "id": truth.id,
        "box": truth.boxes.array,
        "label": truth.label,
        "velocity": truth.velocity,
        "returns": truth.returns,
        "seen_by": None if truth.returns is None else truth.returns > 0,
        "visible_to": truth.visible_to,
        "in_region": everywhere if truth.in_region is None else truth.in_region,
        "counts": everywhere if truth.counts is None else truth.counts,
    }
    return {name: column.copy() for name, column in columns.items() if column is not None}


def _columns(seen: Visibility | PixelVisibility) -> dict[str, NDArray[Any]]:
    return {field.name: getattr(seen, field.name) for field in fields(seen)}
