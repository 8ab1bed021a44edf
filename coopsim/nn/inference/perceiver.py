"""The networks of cooperating agents at work: from sensor data to messages, and from maps to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.cooperative.feature_flow import moved_on
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.encoder import COARSEST, STRIDE
from coopsim.nn.fusion import FusionContext, as_batch
from coopsim.nn.inference.agent_encoder import Look, encoded
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.quick import folded
from coopsim.types import BevGrid, Detections, FeatureMap
from coopsim.types.messages import AGENT_KINDS

REACH_M = 76.8
"""Half the edge of the square that an agent's map covers."""

KINDS = AGENT_KINDS
"""Kinds of agents, in the order in which networks number them."""

_LARGEST = 1e4
"""Beyond any feature of a network, and far within all its numbers."""

_MOST_CELLS, _CELLS_M = 2**18, (0.1, 20.0)


@dataclass(frozen=True, slots=True, eq=False)
class OwnMap:
    """What an agent's encoder makes of what its sensors gave.

    Attributes:
        features: (64, h, w), for its own use.
        message: for the others, with the same cells.
    """

    features: Tensor
    message: FeatureMap


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedMap:
    """A message as tensors.

    Attributes:
        content: the message.
        values: (C + 1, h, w), with the confidences.
        sent: (h, w) the cells that were sent; None: all.
        change: (C, h, w) of the values without confidences, per second; None: they are taken as they are.
    """

    content: FeatureMap
    values: Tensor
    sent: Tensor | None
    change: Tensor | None = None

    def after(self, delay_s: float) -> Tensor:
        """Return `values` as they are after a delay; confidences stay."""
        if self.change is None:
            return self.values
        channels = len(self.change)
        moved = moved_on(self.values[None, :channels], self.change[None], self.values.new_tensor([delay_s]))[0]
        return torch.cat([moved, self.values[channels:]])


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMap:
    """A received map at its place.

    Attributes:
        map: the map.
        sender_SE2_receiver: (3,) x m, y m, yaw rad of the receiver's frame in the sender's.
        delay_s: its age.
        kind: of the sender, by `KINDS`.
    """

    map: ReceivedMap
    sender_SE2_receiver: Floats
    delay_s: float
    kind: int


def way_to_world_cells(position_m: Floats, cell_m: float) -> Floats:
    """Return the way from an agent to the nearest corner of the world's coarse cells, (2,) m, in the world's axes.

    On cells of the world, the maps of all agents have the same cells: a warp copies, and blurs nothing. The cells are
    those of the encoder's coarsest scale, so that its finer ones are alike, too.

    Args:
        position_m: (2,) of the agent in the world, as it is estimated.
        cell_m: edge of a cell of features.
    """
    step_m = COARSEST / STRIDE * cell_m
    way: Floats = step_m * np.round(position_m / step_m) - position_m
    return way


def compass_region(
    region_m: tuple[float, float], heading_rad: float, cell_m: float, corner_m: Sequence[float] | Floats = (0.0, 0.0)
) -> BevGrid:
    """Return the cells around a region |x| <= X, |y| <= Y of an agent's base frame, in axes in which it is turned.

    Args:
        region_m: X and Y.
        heading_rad: the agent's heading in those axes.
        cell_m: edge of a cell.
        corner_m: (2,) a place, seen from the agent, at which corners of coarse cells meet, see `way_to_world_cells`.
    """
    cos, sin = abs(np.cos(heading_rad)), abs(np.sin(heading_rad))
    extents = (cos * region_m[0] + sin * region_m[1], sin * region_m[0] + cos * region_m[1])
    step_m = COARSEST / STRIDE * cell_m
    sides = []
    for extent_m, start_m in zip(extents, corner_m, strict=True):
        low, high = -np.ceil((extent_m + start_m) / step_m - 1e-9), np.ceil((extent_m - start_m) / step_m - 1e-9)
        sides.append((start_m + step_m * float(low), start_m + step_m * float(high)))
    return BevGrid(sides[0], sides[1], cell_m)


def canvas_around(position_m: Floats, reach_m: float, cell_m: float) -> BevGrid:
    """Return the cells of an encoder's canvas around an agent, which lie on the world's.

    Args:
        position_m: (2,) of the agent in the world, as it is estimated.
        reach_m: half the edge of the square.
        cell_m: edge of a cell of the canvas.
    """
    x_m, y_m = way_to_world_cells(position_m, STRIDE * cell_m)
    return BevGrid((x_m - reach_m, x_m + reach_m), (y_m - reach_m, y_m + reach_m), cell_m)


class Perceiver:
    """What agents saw, and the cooperative network that works on it.

    Args:
        net: of several agents.
        cell_m: edge of a cell of the encoders' canvases.
        space: number of the networks, which their messages carry.
        backend: on which they compute.
    """

    def __init__(self, net: CooperativeNet, cell_m: float, space: int, backend: Backend = PROCESSOR) -> None:
        self._reach_m = cell_m * COARSEST * round(REACH_M / cell_m / COARSEST)
        self._space, self._backend, self._canvas_m = space, backend, cell_m
        self.cell_m = STRIDE * cell_m
        self._net, self._head = backend.place(net), backend.place(folded(net.head))
        self._channels = net.message_channels
        self._accepted = (self._channels,) if net.flow is None else (self._channels, 2 * self._channels)

    def encode(self, looks: Sequence[Look], positions_m: Sequence[Floats]) -> list[OwnMap]:
        """Return the maps of A agents.

        Args:
            looks: of each what it saw, see `coopsim.nn.inference.agent_encoder`.
            positions_m: (2,) of each in the world, as it is estimated: its map lies on the world's cells.
        """
        return self._backend.map(self._encode, looks, positions_m)

    def region(self, region_m: tuple[float, float], heading_rad: float, position_m: Floats) -> BevGrid:
        """Return the world's cells around a region of an agent's base frame, see `compass_region`."""
        return compass_region(region_m, heading_rad, self.cell_m, way_to_world_cells(position_m, self.cell_m))

    def _encode(self, looks: Sequence[Look], positions_m: Sequence[Floats]) -> list[OwnMap]:
        canvases = [canvas_around(position_m, self._reach_m, self._canvas_m) for position_m in positions_m]
        with self._backend.inference():
            features = encoded(looks, canvases)
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
            fused: Tensor = self._net(inside[0], own_mask[0], values[:, : self._channels], mask, context)
        return fused

    def alone(self, received: ReceivedMap) -> Tensor:
        """Return a sender's features (64, h, w) as its message alone shows them."""
        values = received.values[None, : self._channels]
        with self._backend.inference():
            features: Tensor = self._net.expand(values, values.new_zeros(1))[0]
            return features if received.sent is None else features * received.sent

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
