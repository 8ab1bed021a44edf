"""Inference of instance queries: frame after frame, from sensor data and messages to instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.inference.backend import PROCESSOR, Backend, to_device
from coopsim.nn.inference.canvas import canvas_around, compass_region, way_to_world_cells
from coopsim.nn.inference.encoders import SensedFrame, encode_frames, folded
from coopsim.nn.queries.cooptrack_fusion import ReceivedInstances, aligned_boxes
from coopsim.nn.queries.instances import Instances
from coopsim.nn.queries.query_net import LEAST_SCORE, QueryNet, SeenMap, kept_instances
from coopsim.types import NS_PER_S, BevGrid, Detections, InstanceQueries, Tracks
from coopsim.types.features import FAST_M_S
from coopsim.types.valid_detections import FARTHEST_M

_LARGEST = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class QueryState:
    """Instances of an agent after a frame, in its compass frame then, and the number of the next new one."""

    time_ns: int
    odom_SE3_compass: SE3
    instances: Instances
    next_number: int

    def at(self, time_ns: int, odom_SE3_compass: SE3) -> Instances:
        """Return the instances in the agent's compass frame at a later time, moved on by their velocities."""
        later = self.instances.advanced((time_ns - self.time_ns) / NS_PER_S)
        return later.moved(odom_SE3_compass.inverse().compose(self.odom_SE3_compass))


class QueryPerceiver:
    """Run a network of instance queries on the encoder and head of a detector.

    Args:
        net: network of the queries.
        detector: network with the head.
        space: number of the networks, which their messages carry.
        backend: device and arithmetic.
    """

    def __init__(self, net: QueryNet, detector: DetectorNet, space: int, backend: Backend = PROCESSOR) -> None:
        cell_m = detector.config.cell_m
        self._net, self._head = backend.place(net), backend.place(folded(detector.head))
        self._space, self._backend = space, backend
        self._canvas_m, self._width = cell_m, net.config.width

    def see(self, frames: Sequence[SensedFrame]) -> list[SeenMap]:
        """Return the maps of A agents, each on the world's cells around its estimated position."""
        return self._backend.map(self._see, frames)

    def step(
        self,
        before: QueryState | None,
        time_ns: int,
        odom_SE3_compass: SE3,
        seen: SeenMap,
        received: Sequence[ReceivedInstances] = (),
        least_affinity: float = 0.5,
    ) -> QueryState:
        """Return an agent's state after a frame: refined instances with numbers, without duplicates.

        Args:
            before: state after the frame before; None: this is the first.
            time_ns: time of the frame.
            odom_SE3_compass: the agent's compass frame now, in its odometry frame.
            seen: the agent's own map now.
            received: senders in the order in which they are fused.
            least_affinity: smallest affinity of a pair.
        """
        with self._backend.inference(), torch.autocast(self._backend.device.type, enabled=False):
            known, dt_s = self.nothing(), 0.0
            if before is not None:
                known = before.instances.moved(odom_SE3_compass.inverse().compose(before.odom_SE3_compass))
                dt_s = (time_ns - before.time_ns) / NS_PER_S
            step = self._net(known, dt_s, seen, received, least_affinity=least_affinity)
            found = kept_instances(step.instances)
        return QueryState(time_ns, odom_SE3_compass, *found.numbered(0 if before is None else before.next_number))

    def nothing(self) -> Instances:
        """Return no instances."""
        return self._net.nothing()

    def region(self, region_m: tuple[float, float], heading_rad: float, position_m: Floats) -> BevGrid:
        """Return the world's cells around a region of an agent's base frame, see `compass_region`."""
        cell_m = STRIDE * self._canvas_m
        return compass_region(region_m, heading_rad, cell_m, way_to_world_cells(position_m, cell_m))

    def placed(self, known: Instances, receiver_SE3_sender: SE3, delay_s: float, region: BevGrid) -> ReceivedInstances:
        """Return a sender's instances, in its compass frame, less those that are outside the receiver's region now."""
        x, y = aligned_boxes(known, receiver_SE3_sender, delay_s).box[:, :2].T
        inside = (region.x_m[0] <= x) & (x <= region.x_m[1]) & (region.y_m[0] <= y) & (y <= region.y_m[1])
        return ReceivedInstances(known[inside], receiver_SE3_sender, delay_s)

    def message(self, known: Instances, heading_rad: float) -> InstanceQueries:
        """Return instances as they are sent: in the base frame, with their features and velocities as one vector."""
        placed = known.moved(SE3.from_xyz_yaw(np.zeros(3), -heading_rad))
        vectors = torch.cat([placed.semantic, placed.motion, placed.velocity / FAST_M_S], dim=1)
        found = detections_of(placed)
        return InstanceQueries(vectors.numpy(force=True), found.boxes, found.score, found.label, self._space)

    def receive(self, content: InstanceQueries) -> Instances:
        """Return a message as instances in the sender's base frame: the surest that fit into an agent's mind.

        Raises:
            CodecError: it is of another network, or not what any network sends.
        """
        if content.space != self._space:
            raise CodecError(
                f"the queries are of network {content.space}, not of {self._space}: nobody here reads them"
            )
        length = content.feature.shape[1]
        if length != 2 * self._width + 2:
            raise CodecError(f"queries must have {2 * self._width + 2} numbers, got {length}")
        if not np.abs(content.feature).max(initial=0.0) <= _LARGEST:
            raise CodecError(f"queries must be finite and within {_LARGEST:g}")
        if np.abs(content.boxes.array).max(initial=0.0) > FARTHEST_M:
            raise CodecError(f"boxes must be within {FARTHEST_M:g} m of their sender")
        known = self._instances(content, torch.from_numpy(np.array(content.feature)))
        return self._backend.put(known.surest(self._net.config.places))

    def shown(
        self, content: InstanceQueries, vectors: Tensor, heading_rad: float, offset_m: Floats
    ) -> tuple[Tensor, Tensor]:
        """Return the logits (K, 9) and boxes (K, 7) in the sender's base frame that a message alone shows a receiver.

        Both have the gradients of its vectors.

        Args:
            content: message of K queries.
            vectors: (K, D) vectors instead of the message's own.
            heading_rad: heading of the sender.
            offset_m: (3,) place of the sender less that of the receiver, in the world's axes.
        """
        compass_SE3_base = SE3.from_xyz_yaw(np.zeros(3), heading_rad)
        receiver_SE3_sender = SE3.from_xyz_yaw(offset_m, 0.0)
        with torch.enable_grad():
            known = self._backend.put(self._instances(content, vectors)).moved(compass_SE3_base)
            found, logits = self._net.shown(ReceivedInstances(known, receiver_SE3_sender, 0.0))
            placed = found.moved(receiver_SE3_sender.compose(compass_SE3_base).inverse())
        return logits, placed.box

    def _instances(self, content: InstanceQueries, vectors: Tensor) -> Instances:
        """Return a message with these vectors as instances in the sender's base frame."""
        box, score = (torch.from_numpy(np.array(each, np.float32)) for each in (content.boxes.array, content.score))
        seen = self._net.seen(box, score.clamp(0.0, 1.0), torch.from_numpy(np.array(content.label)))
        first, last = self._width, 2 * self._width
        semantic, motion, velocity = vectors[:, :first], vectors[:, first:last], vectors[:, last:]
        return replace(seen, semantic=semantic, motion=motion, velocity=velocity * FAST_M_S).as_received()

    def _see(self, frames: Sequence[SensedFrame]) -> list[SeenMap]:
        canvases = [canvas_around(each.position_m, self._canvas_m) for each in frames]
        with self._backend.inference():
            maps = encode_frames(frames, canvases).float()
            return [
                seen_map(self._net, self._head, maps[k : k + 1], canvas.coarser(STRIDE))
                for k, canvas in enumerate(canvases)
            ]


def seen_map(net: QueryNet, head: torch.nn.Module, features: Tensor, grid: BevGrid) -> SeenMap:
    """Return a map (1, C, h, w), and the surest peaks of a centre head on it, as instances."""
    return SeenMap(features[0], grid, peaks_of(net, head, features, grid))


class InstanceNet(Protocol):
    """Network that keeps at most `config.places` instances."""

    config: Any

    def seen(self, box: Tensor, score: Tensor, label: Tensor) -> Instances:
        """Return new instances of boxes (K, 7), scores (K,) and labels (K,)."""
        ...


def peaks_of(net: InstanceNet, head: torch.nn.Module, features: Tensor, grid: BevGrid) -> Instances:
    """Return the surest peaks of a centre head on a map (1, C, h, w), as instances of a network's sizes."""
    found = decode(head, features, grid, least_score=LEAST_SCORE)[0][: net.config.places]  # type: ignore[arg-type]
    box = torch.from_numpy(found.boxes.array.astype(np.float32))
    score = torch.from_numpy(found.score.astype(np.float32))
    seen: Instances = to_device(net.seen(box, score, torch.from_numpy(np.array(found.label))), features.device)
    return seen


def detections_of(known: Instances) -> Detections:
    """Return instances as detections in their frame."""
    boxes = Boxes3D.from_array(known.box.double().numpy(force=True))
    return Detections(boxes, known.score.double().numpy(force=True), known.label.numpy(force=True))


def tracks_of(known: Instances, found: Detections, base_SE3_compass: SE3) -> Tracks:
    """Return instances as tracks in the base frame.

    Args:
        known: the instances, in the compass frame.
        found: tracks to report, in the base frame, each with its row in `known` as the one number of its embedding.
        base_SE3_compass: the turn between the frames.
    """
    if found.embedding is None:
        return Tracks.empty()
    rows = found.embedding[:, 0].astype(np.int64)
    velocity = base_SE3_compass.rotate_planar(known.velocity.double().numpy(force=True)[rows])
    return Tracks(known.number.numpy(force=True)[rows], found.boxes, velocity, found.score, found.label)
