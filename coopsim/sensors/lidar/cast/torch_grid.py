"""The sweeps of `coopsim.sensors.lidar.cast.ray_grid` by torch, for machines with a GPU.

The same idea without a loop: every triangle is tested against the rays between its ends in elevation and azimuth, all
such pairs of a triangle and a ray at once. A ray meets the triangle (v0, v1, v2) exactly if it is on one side of the
three planes through the sensor and an edge (the edge functions of `coopsim.sensors.lidar.cast.raster_kernel`): three
dot products.
A fourth is the inverse of the range, and a scattered maximum keeps each ray's largest. In float64: the pairs are few,
and a GPU may be told to round the factors of float32 products to ten bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.cast.raster_kernel import LANES
from coopsim.sensors.lidar.cast.ray_grid import Grid, GridHits
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import Triangles

_MOST_PAIRS = 1 << 20
"""Of a triangle and a ray, at once: some 200 MiB."""

_SLACK_RAD = 1e-9
_EDGE_ON_M3 = 1e-12
"""Volume between the sensor and a triangle below which no ray meets it."""

_LAST_FACE = (1 << 31) - 1


class TorchGrid(Grid):
    """The rays of a beam table, ready to be cast by torch.


    Stands in for `coopsim.sensors.lidar.cast.ray_grid.RayGrid`, with the same hits but for rays that pass an edge
    within rounding or meet two triangles that are equally near; and closed parts are seen from inside, too.

    Args:
        pattern: the beams.
        columns: firings per turn.
        device: of torch; None: "cuda" where there is one, else "cpu", which takes far longer than the grid.
    """

    def __init__(self, pattern: BeamPattern, columns: int, device: str | None = None) -> None:
        super().__init__(pattern, columns)
        self.device = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
        # Rows are beams from the bottom one to the top.
        order = np.argsort(pattern.elevation_rad, kind="stable")
        self._beam = self._there(order)
        self._elevation_rad = self._there(pattern.elevation_rad[order])
        self._aside_rad = self._there(pattern.offset_rad[order])
        self._directions = self._there(pattern.directions(columns))

    def cast_sector(
        self, triangles: Triangles, world_SE3_sensor: SE3, blocks: tuple[int, int], hits: GridHits, threads: int = 1
    ) -> None:
        local = (triangles.vertices - world_SE3_sensor.translation) @ world_SE3_sensor.rotation
        corners = self._there(local)[self._there(triangles.faces)]
        planes, normals = _half_spaces(corners)
        sector = slice(blocks[0] * LANES, min(blocks[1] * LANES, self._shape[1]))
        best = torch.zeros(len(self._directions), dtype=torch.int64, device=self.device)
        for face, ray in self._pairs(_spans(corners), sector):
            products = torch.einsum("nij,nj->ni", planes[face], self._directions[ray])
            met = (products[:, :3].amin(dim=1) >= 0) & (products[:, 3] > 0)
            # The bits of positive floats have their order; of equals the first face has the largest key.
            bits = products[met, 3].float().view(torch.int32).long()
            best.scatter_reduce_(0, ray[met], (bits << 32) | (_LAST_FACE - face[met]), "amax")
        best = best.reshape(self._shape)[:, sector]
        rays = self._directions.reshape(*self._shape, 3)[:, sector]
        hit = best > 0
        face = (_LAST_FACE - (best & _LAST_FACE)).where(hit, 0)
        away_m = torch.full(hit.shape, torch.inf, dtype=torch.float32, device=self.device)
        cosine = torch.zeros(hit.shape, dtype=torch.float32, device=self.device)
        # Who is nearest was found in float32; how near is computed once more.
        away_m[hit] = (1.0 / (planes[face[hit], 3] * rays[hit]).sum(dim=1)).float()
        cosine[hit] = (normals[face[hit]] * rays[hit]).sum(dim=1).abs().clamp(max=1.0).float()
        hits.range_m[:, sector] = away_m.cpu().numpy()
        hits.face[:, sector] = face.where(hit, -1).cpu().numpy()
        hits.cosine[:, sector] = cosine.cpu().numpy()

    def _pairs(self, spans: _Spans, sector: slice) -> Iterator[tuple[Tensor, Tensor]]:
        """Faces (N,) and rays (N,) that may meet, in portions."""
        first = torch.searchsorted(self._elevation_rad, spans.low_rad - _SLACK_RAD)
        rows = torch.searchsorted(self._elevation_rad, spans.high_rad + _SLACK_RAD, right=True) - first
        face, row = _spread(first, rows)
        per_rad = self._shape[1] / (2 * math.pi)
        right_rad = spans.right_rad[face] - self._aside_rad[row]
        start = ((right_rad - _SLACK_RAD) * per_rad).ceil().long()
        end = ((right_rad + spans.width_rad[face] + _SLACK_RAD) * per_rad).floor().long()
        count = (end - start + 1).clamp(0, self._shape[1])
        portion, lines = count.cumsum(0) // _MOST_PAIRS, torch.arange(len(face), device=self.device)
        for number in torch.unique(portion):
            some = lines[portion == number]
            line, column = _spread(start[some], count[some])
            column = column.remainder(self._shape[1])
            kept = (column >= sector.start) & (column < sector.stop)
            line, column = some[line[kept]], column[kept]
            yield face[line], self._beam[row[line]] * self._shape[1] + column

    def _there(self, values: NDArray[Any]) -> Tensor:
        return torch.from_numpy(np.array(values)).to(self.device)


class _Spans(NamedTuple):
    """Where F triangles are seen, (F,) each: bounds that may be wider than they."""

    low_rad: Tensor
    high_rad: Tensor
    right_rad: Tensor
    width_rad: Tensor


def _spans(corners: Tensor) -> _Spans:
    """Of triangles (F, 3, 3) in the sensor's axes."""
    ends = corners.roll(-1, dims=1)
    ground, along = corners[:, :, :2], (ends - corners)[:, :, :2]
    far = ground.norm(dim=2).amax(dim=1)
    share = (-(ground * along).sum(dim=2) / (along * along).sum(dim=2).clamp(min=1e-300)).clamp(0, 1)
    near = (ground + share[:, :, None] * along).norm(dim=2).amin(dim=1)
    turn = ground[:, :, 0] * along[:, :, 1] - ground[:, :, 1] * along[:, :, 0]
    around = (turn >= 0).all(dim=1) | (turn <= 0).all(dim=1) | (near == 0)
    near = near.where(~around, 0.0)
    low, high = corners[:, :, 2].amin(dim=1), corners[:, :, 2].amax(dim=1)
    azimuth = torch.atan2(ground[:, :, 1], ground[:, :, 0])
    past = torch.remainder(azimuth - azimuth[:, :1] + math.pi, 2 * math.pi) - math.pi
    return _Spans(
        torch.atan2(low, near.where(low < 0, far)),
        torch.atan2(high, near.where(high > 0, far)),
        azimuth[:, 0] + past.amin(dim=1),
        (past.amax(dim=1) - past.amin(dim=1)).where(~around, 2 * math.pi),
    )


def _half_spaces(corners: Tensor) -> tuple[Tensor, Tensor]:
    """What decides on a ray, of F triangles (F, 3, 3) in the sensor's axes.

    Returns:
        (F, 4, 3): rays of which no product with the first three is negative meet the triangle, at the inverse of that
        with the fourth, which is 0 for what is seen edge-on. And unit normals (F, 3).
    """
    a, b, c = corners.unbind(dim=1)
    normals = torch.linalg.cross(b - a, c - a)
    volume = (normals * a).sum(dim=1, keepdim=True)
    # For two triangles that share an edge exactly opposite: no ray slips through.
    edges = [torch.linalg.cross(*pair) * volume.sign() for pair in ((a, b), (b, c), (c, a))]
    inverse = (normals / volume).where(volume.abs() > _EDGE_ON_M3, 0.0)
    unit = normals / normals.norm(dim=1, keepdim=True).clamp(min=1e-300)
    return torch.stack([*edges, inverse], dim=1), unit


def _spread(first: Tensor, count: Tensor) -> tuple[Tensor, Tensor]:
    """`count` (N,) successive numbers from `first` (N,) on, one after another, and to which of N each belongs."""
    owner = torch.repeat_interleave(torch.arange(len(count), device=count.device), count)
    before = count.cumsum(0) - count
    return owner, first[owner] + torch.arange(len(owner), device=count.device) - before[owner]
