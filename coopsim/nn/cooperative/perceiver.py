"""Inference of cooperating agents: from sensor data to messages, and from maps to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.nn.cooperative.cooperative_net import CooperativeNet, moved_on
from coopsim.nn.cooperative.warp import placing, warp
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.fusion import FusionContext, as_batch
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.canvas import canvas_around, compass_region, way_to_world_cells
from coopsim.nn.inference.encoders import SensedFrame, encode_frames, folded
from coopsim.types import BevGrid, Detections, FeatureMap
from coopsim.types.messages import AGENT_KINDS

KINDS = AGENT_KINDS
"""Kinds of agents, in the order in which networks number them."""

_LARGEST = 1e4
"""Beyond any feature of a network, and far within all its numbers."""

_MOST_CELLS, _CELLS_M = 2**18, (0.1, 20.0)


@dataclass(frozen=True, slots=True, eq=False)
class OwnMap:
    """Features (64, h, w) of an agent's encoder, and the message with the same cells."""

    features: Tensor
    message: FeatureMap


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedMap:
    """Message as tensors.

    Attributes:
        content: the message.
        values: (C + 1, h, w), with the confidences.
        sent: (h, w) the cells that were sent; None: all.
        change: (C, h, w) derivative of the values without confidences, per second; None: none was sent.
    """

    content: FeatureMap
    values: Tensor
    sent: Tensor | None
    change: Tensor | None = None

    def after(self, delay_s: float) -> Tensor:
        """Return `values` after a delay; confidences stay."""
        if self.change is None:
            return self.values
        channels = len(self.change)
        moved = moved_on(self.values[None, :channels], self.change[None], self.values.new_tensor([delay_s]))[0]
        return torch.cat([moved, self.values[channels:]])


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMap:
    """Received map at its place.

    Attributes:
        map: the map.
        sender_SE2_receiver: (3,) x m, y m, yaw rad of the receiver's frame in the sender's.
        delay_s: its age.
        kind: index of the sender's kind in `KINDS`.
        error: standard deviations of this place (m) and its heading (rad): as both agents state their errors, or as
            common objects leave them.
    """

    map: ReceivedMap
    sender_SE2_receiver: Floats
    delay_s: float
    kind: int
    error: tuple[float, float] = (0.0, 0.0)


class Perceiver:
    """Run a cooperative network: encode, receive, fuse, detect.

    Args:
        net: network of several agents.
        cell_m: edge of a cell of the encoders' canvases.
        space: number of the networks, which their messages carry.
        backend: device and arithmetic.
    """

    def __init__(self, net: CooperativeNet, cell_m: float, space: int, backend: Backend = PROCESSOR) -> None:
        self._space, self._backend, self._canvas_m = space, backend, cell_m
        self.cell_m = STRIDE * cell_m
        self._net, self._head = backend.place(net), backend.place(folded(net.head))
        self._channels = net.message_channels
        self._accepted = (self._channels,) if net.flow is None else (self._channels, 2 * self._channels)

    def encode(self, frames: Sequence[SensedFrame]) -> list[OwnMap]:
        """Return the maps of A agents, each on the world's cells around its estimated position."""
        return self._backend.map(self._encode, frames)

    def region(self, region_m: tuple[float, float], heading_rad: float, position_m: Floats) -> BevGrid:
        """Return the world's cells around a region of an agent's base frame, see `compass_region`."""
        return compass_region(region_m, heading_rad, self.cell_m, way_to_world_cells(position_m, self.cell_m))

    def _encode(self, frames: Sequence[SensedFrame]) -> list[OwnMap]:
        canvases = [canvas_around(each.position_m, self._canvas_m) for each in frames]
        with self._backend.inference():
            features = encode_frames(frames, canvases)
            values, confidence = (each.numpy(force=True) for each in self._net.message(features))
        return [
            OwnMap(own, FeatureMap(sent, canvas.coarser(STRIDE), sure, space=self._space))
            for own, sent, canvas, sure in zip(features, values, canvases, confidence, strict=True)
        ]

    def receive(self, content: FeatureMap) -> ReceivedMap:
        """Return a message as tensors.

        Raises:
            CodecError: it is of another network, or not what any network sends.
        """
        channels, rows, columns = content.values.shape
        if content.space != self._space:
            raise CodecError(
                f"the features are of network {content.space}, not of {self._space}: nobody here reads them"
            )
        if channels not in self._accepted:
            raise CodecError(f"features must have {' or '.join(map(str, self._accepted))} channels, got {channels}")
        if rows * columns > _MOST_CELLS or not _CELLS_M[0] <= content.grid.cell_m <= _CELLS_M[1]:
            raise CodecError(f"a map of {rows} x {columns} cells of {content.grid.cell_m:g} m is none of a network")
        if not np.abs(content.values).max(initial=0.0) <= _LARGEST:
            raise CodecError(f"features must be finite and within {_LARGEST:g}")
        confidence = np.zeros((rows, columns), np.float32) if content.confidence is None else content.confidence
        values = np.concatenate([content.values[: self._channels], confidence[None]])
        sent = None if content.sent is None else torch.from_numpy(content.sent.copy())
        change = torch.tensor(content.values[self._channels :]) if channels > self._channels else None
        return ReceivedMap(content, *self._backend.put((torch.from_numpy(values), sent, change)))

    def fuse(self, own: OwnMap, region: BevGrid, received: Sequence[PlacedMap], own_kind: int = 0) -> Tensor:
        """Return fused features (64, H, W) on the cells of a region around the receiver, of kind `own_kind`."""
        with self._backend.inference():
            inside, own_mask = warp(own.features[None], own.message.grid, region, np.zeros((1, 3)))
            placed = [(each, *_warped(each, region)) for each in received]
            placed = [each for each in placed if each[2].any()]
            values = torch.cat([each[1] for each in placed]) if placed else inside[:0]
            mask = torch.cat([each[2] for each in placed]) if placed else own_mask[:0]
            delay_s = torch.tensor([each[0].delay_s for each in placed])
            kind = torch.tensor([each[0].kind for each in placed], dtype=torch.long)
            context = FusionContext(*self._backend.put((delay_s, kind)), values[:, -1], own_kind=own_kind)
            if self._net.tells_errors:
                poses = np.array([each[0].sender_SE2_receiver for each in placed])
                told = self._backend.put(placing(region, poses, [each[0].error for each in placed]))
                context = replace(context, error_m=told[0], range_m=told[1])
            fused: Tensor = self._net(inside[0], own_mask[0], values[:, : self._channels], mask, context)
        return fused

    def alone(self, received: ReceivedMap) -> Tensor:
        """Return a sender's features (64, h, w) as its message alone shows them."""
        values, sent = received.values[None, : self._channels], received.sent
        with self._backend.inference():
            features: Tensor = self._net.expand(
                values, values.new_zeros(1), wanted=None if sent is None else sent[None]
            )[0]
            return features if sent is None else features * sent

    def heat(self, values: Tensor) -> Tensor:
        """Return the logits of the heat (9, h, w) that a message's values (C, h, w) alone show, with gradients."""
        (placed,) = self._backend.put((values[: self._channels],))
        with torch.enable_grad():
            logits: Tensor = self._net.head.heat(self._net.expand(placed[None], placed.new_zeros(1)))[1][0]
        return logits

    def detect(self, features: Tensor, grid: BevGrid, least_score: float) -> Detections:
        """Return the detections in a map of features (64, H, W), in the frame of its grid."""
        with self._backend.inference():
            return decode(self._head, as_batch(features), grid, least_score=least_score)[0]


def _warped(placed: PlacedMap, region: BevGrid) -> tuple[Tensor, Tensor]:
    """Return values (1, C + 1, H, W) of now and valid cells (1, H, W) of a map in the receiver's region."""
    received = placed.map
    present = None if received.sent is None else received.sent[None]
    values = received.after(placed.delay_s)[None]
    return warp(values, received.content.grid, region, placed.sender_SE2_receiver[None], present)
