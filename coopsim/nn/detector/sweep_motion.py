"""Motions of boxes from two sweeps: what lies in a box now is looked for in what lay around it before.

Both sweeps are counted in cells that turn with the box, go through the same layers, and are correlated at all shifts
(the correlation of FlowNetC, Dosovitskiy et al., ICCV 2015, section 3, with learned features of counts).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.localization.odometry import Points
from coopsim.support.kernels import njit

ROWS, COLUMNS = 12, 36
"""Cells across and along a box."""

_ACROSS, _ALONG = 4, 16
"""Largest shifts that are looked at, in cells: 4.8 m along a car."""

_FINEST_M, _COARSEST_M, _CELLS_OF_LENGTH = 0.08, 0.3, 10
"""Edges of cells: a part of the box's length, between these."""

_BANDS = 3
_BAND_EDGES = np.array([0.12, 0.4, 0.75, 1.1])
"""Heights between which points count, as shares of the box's: the ground is below, and a tree's crown above."""

_WIDTH = 8

_STRIP_M, _STRIPS = 4.0, 64
"""Width and number of the strips in which a box's points are looked for."""

_CLEARLY_M_S = 1.5
"""Speed backwards from which a box is thought to be the wrong way round."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxSweeps:
    """Two sweeps around N boxes.

    Attributes:
        counts: (N, 2 x 3, ROWS, COLUMNS) number of points in each cell, by height; those of now first.
        cell_m_s: (N,) speed with which a point moves on by one cell between the sweeps, m/s.
    """

    counts: Tensor
    cell_m_s: Tensor


def box_sweeps(points: Points, boxes: Floats) -> BoxSweeps:
    """Count the points of two sweeps around boxes.

    Args:
        points: (P, 5) x, y, z, intensity and age; an age above 0 is that of the sweep before.
        boxes: (N, 7) x, y, z, l, w, h, yaw in the points' frame.
    """
    cell_m = np.clip(boxes[:, 3] / _CELLS_OF_LENGTH, _FINEST_M, _COARSEST_M)
    x, y, z, _, age_s = np.ascontiguousarray(points.T)
    counts = _counted(x, y, z, age_s, np.ascontiguousarray(boxes, dtype=np.float64), cell_m)
    speed = cell_m / max(float(points[:, 4].max(initial=0.0)), 1e-3)
    return BoxSweeps(torch.from_numpy(counts), torch.from_numpy(speed.astype(np.float32)))


class SweepMotion(nn.Module):
    """A network of 962 weights from two sweeps around boxes to the boxes' motions.

    Its layers know of cells and shifts alone, so cars teach it of people, and streets of all directions.
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(_BANDS, _WIDTH, 3, padding=1), nn.ReLU(), nn.Conv2d(_WIDTH, _WIDTH, 3, padding=1)
        )
        self.refine = nn.Sequential(nn.Conv2d(1, _WIDTH, 3, padding=1), nn.ReLU(), nn.Conv2d(_WIDTH, 1, 3, padding=1))
        self.scale = nn.Parameter(torch.tensor(10.0))

    def forward(self, sweeps: BoxSweeps) -> Tensor:
        """Return velocities (N, 2) along boxes and to their left, m/s: the mean of all shifts by their likelihood."""
        counts = sweeps.counts
        if not len(counts):
            return counts.new_zeros(0, 2)
        with torch.autocast(counts.device.type, enabled=False):
            found = self.layers(torch.log1p(counts).view(-1, _BANDS, ROWS, COLUMNS))
            found = (found / (found.flatten(1).norm(dim=1)[:, None, None, None] + 1e-3)).view(-1, 2, *found.shape[1:])
            alike = self.scale * _correlated(found[:, 0], found[:, 1])
            chance = (alike + self.refine(alike[:, None])[:, 0]).flatten(1).softmax(1).view_as(alike)
        left, along = (torch.arange(-most, most + 1.0, device=chance.device) for most in (_ACROSS, _ALONG))
        shift = torch.stack([(chance.sum(1) * along).sum(1), (chance.sum(2) * left).sum(1)], dim=1)
        return shift * sweeps.cell_m_s[:, None]

    def look(self, points: Points, boxes: Floats) -> tuple[Floats, Floats]:
        """Return boxes (N, 7) that head to where they clearly move, and their velocities over ground (N, 2) m/s.

        Args:
            points: (P, 5) of both sweeps.
            boxes: (N, 7) in the points' frame; some may be the wrong way round.
        """
        seen, device = box_sweeps(points, boxes), self.scale.device
        motion = self(BoxSweeps(seen.counts.to(device), seen.cell_m_s.to(device))).double().numpy(force=True)
        turned = boxes.copy()
        turned[:, 6] = np.where(motion[:, 0] < -_CLEARLY_M_S, wrap_angle(boxes[:, 6] + np.pi), boxes[:, 6])
        return turned, over_ground(motion, boxes[:, 6])


def over_ground(motion: Floats, yaw: Floats) -> Floats:
    """Return velocities (N, 2) in a frame, given along and left of boxes that head to `yaw` (N,) in it."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    along, left = motion.T
    return np.stack([cos * along - sin * left, sin * along + cos * left], axis=1)


def _correlated(now: Tensor, before: Tensor) -> Tensor:
    """Return the likeness (N, 2 _ACROSS + 1, 2 _ALONG + 1) of features (N, C, h, w) at each shift since before."""
    size = (now.shape[2] + _ACROSS, now.shape[3] + _ALONG)  # the ends of a larger shift may meet beyond
    product = torch.fft.rfft2(now, s=size) * torch.fft.rfft2(before, s=size).conj()
    alike = torch.fft.irfft2(product.sum(1), s=size).roll((_ACROSS, _ALONG), (1, 2))
    near: Tensor = alike[:, : 2 * _ACROSS + 1, : 2 * _ALONG + 1]
    return near


@njit(cache=True, nogil=True)
def _strip(x):  # type: ignore[no-untyped-def]
    """Return the number of the strip that a place lies in; what lies beyond the last ones is in these."""
    return int(min(max(x / _STRIP_M + _STRIPS / 2, 0.0), _STRIPS - 1.0))


@njit(cache=True, nogil=True)
def _by_strip(x):  # type: ignore[no-untyped-def]
    """Return points (P,) by strips of x in turn, and where each strip starts (_STRIPS + 1,)."""
    start = np.zeros(_STRIPS + 1, np.int64)
    for each in x:
        start[_strip(each) + 1] += 1
    start = np.cumsum(start)
    order, after = np.empty(len(x), np.int64), start.copy()
    for p in range(len(x)):
        order[after[_strip(x[p])]] = p
        after[_strip(x[p])] += 1
    return order, start


@njit(cache=True, nogil=True)
def _counted(x, y, z, age_s, boxes, cell_m):  # type: ignore[no-untyped-def]
    """Return the counts of `BoxSweeps`; along the box a point is shared by the two nearest cells."""
    counts = np.zeros((len(boxes), 2 * _BANDS, ROWS, COLUMNS), np.float32)
    order, start = _by_strip(x)
    x, y, z, age_s = x[order], y[order], z[order], age_s[order]
    for n in range(len(boxes)):
        cos, sin = np.cos(boxes[n, 6]) / cell_m[n], np.sin(boxes[n, 6]) / cell_m[n]
        reach, bottom = np.hypot(ROWS, COLUMNS) / 2 * cell_m[n], boxes[n, 2] - boxes[n, 5] / 2
        for p in range(start[_strip(boxes[n, 0] - reach)], start[_strip(boxes[n, 0] + reach) + 1]):
            dx, dy = x[p] - boxes[n, 0], y[p] - boxes[n, 1]
            if abs(dx) > reach or abs(dy) > reach:
                continue
            band = -1
            for edge in _BAND_EDGES:
                band += (z[p] - bottom) / boxes[n, 5] >= edge
            row = int(np.floor(cos * dy - sin * dx + ROWS / 2))
            if band < 0 or band >= _BANDS or row < 0 or row >= ROWS:
                continue
            if age_s[p] > 0:
                band += _BANDS
            column = cos * dx + sin * dy + (COLUMNS - 1) / 2
            first = int(np.floor(column))
            if 0 <= first < COLUMNS:
                counts[n, band, row, first] += first + 1 - column
            if 0 <= first + 1 < COLUMNS:
                counts[n, band, row, first + 1] += column - first
    return counts
