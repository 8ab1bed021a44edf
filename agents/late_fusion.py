"""Late fusion: agents share boxes; each receiver pools them, merges duplicates, and tracks the rest.

The baseline of that name in the tables of cooperative perception (V2V4Real, Xu et al., CVPR 2023; DINO-CoDT, He et al.,
Table II).
A box is moved by the *estimated* poses of sender and receiver and taken as if it were measured now, so both
pose noise and latency show in full.
"""

from __future__ import annotations

import numpy as np

from coopsim.agents.ab3dmot import AB3DMOT
from coopsim.catalog import POLICIES
from coopsim.checks import require_threshold
from coopsim.comms.message import decode_detections
from coopsim.fusion.late import merge_duplicates
from coopsim.types import Detections, Message, Observation


@POLICIES.register("late_fusion")
class LateFusion(AB3DMOT):
    """AB3DMOT on all agents' boxes, duplicates merged.

    Args:
        merge_iou: BEV IoU from which two boxes of a class are the same object, in (0, 1].
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: detections until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    uplink = "detections"

    def __init__(self, merge_iou: float = 0.15, gate: float = -0.2, hits: int = 3, age: int = 2) -> None:
        super().__init__(gate, hits, age)
        require_threshold(merge_iou=merge_iou)
        self._merge_iou = merge_iou

    def gather(self, observation: Observation) -> Detections:
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        received = [
            decode_detections(message).transform(base_SE3_world.compose(message.pose.world_SE3_base))
            for message in newest_by_sender(observation.inbox)
        ]
        pooled = Detections.concatenate([observation.detections, *received])
        return merge_duplicates(without_self(pooled), iou_threshold=self._merge_iou)


def newest_by_sender(inbox: tuple[Message, ...]) -> list[Message]:
    """The message with the latest capture of each sender, in order of the senders' first appearance."""
    newest: dict[str, Message] = {}
    for message in inbox:
        if message.sender not in newest or message.captured_ns >= newest[message.sender].captured_ns:
            newest[message.sender] = message
    return list(newest.values())


def without_self(detections: Detections) -> Detections:
    """Leave out boxes over the origin: others report the receiver too, but it is not its own object."""
    boxes = detections.boxes
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    x, y = boxes.center[:, 0], boxes.center[:, 1]
    ahead, aside = np.abs(x * cos + y * sin), np.abs(y * cos - x * sin)
    return detections[(ahead > boxes.size[:, 0] / 2) | (aside > boxes.size[:, 1] / 2)]
