"""A plot of ground, on which furniture is put up piece by piece."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask
from coopsim.world.furniture.free_ground import (
    BULKY,
    CROWN,
    GROUND,
    UNPAVED,
    Discs,
    Obstacles,
    Wishes,
    are_free,
    settle,
)
from coopsim.world.furniture.kinds import KINDS

_GAP_M = 0.4
"""Between two pieces."""

_IN_YARDS = ("cafe_table", "scaffold")
_LAMP_HEAD_M = 0.6
_HEAD_AHEAD_M = 1.2  # of a lamp, before its post


class Plot:
    """Free ground, and what has been put on it.

    Args:
        obstacles: what stays free.

    Attributes:
        entries: furniture so far, as entries of a file.
    """

    def __init__(self, obstacles: Obstacles) -> None:
        self.entries: list[dict[str, Any]] = []
        self._obstacles = obstacles
        self._standing = Discs(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))

    def put(
        self, kind: str, stands: Floats, choice: Ints | None = None, *, bulky: bool = False, sizes: Floats | None = None
    ) -> Mask:
        """Put up the pieces that fit; return their mask (N,).

        Args:
            kind: of all pieces.
            stands: (N, 3) places x, y (m) and headings (rad).
            choice: (N,) pieces that follow each other with one number are alternatives; None: there are none.
            bulky: whether they hide people who are about to cross.
            sizes: (N, S) m, in the order of the kind's; None: the usual ones.
        """
        count = len(stands)
        discs, each = self._discs(kind, stands, bulky=bulky, sizes=sizes)
        none = np.full(count, -1)
        fits = self._settle(discs, each, none if choice is None else choice, none)
        degrees = np.round(np.degrees(stands[:, 2]), 3)
        for n in np.flatnonzero(fits).tolist():
            entry = {"kind": kind, "at": _rounded(stands[n, :2]), "heading_deg": float(degrees[n])}
            if sizes is not None:
                entry |= {name: float(size) for name, size in zip(KINDS[kind].sizes, sizes[n], strict=True)}
            self.entries.append(entry)
        return fits

    def are_free(self, kind: str, ends: Floats, *, bulky: bool) -> Mask:
        """Return which pieces (N, 2, 2) m of a line keep off what stays free, whatever stands there already."""
        return are_free(ends.mean(axis=1), 1.1 * _half_m(kind), _layers(kind, bulky=bulky), self._obstacles)

    def put_lines(self, kind: str, ends: Floats, run: Ints, *, bulky: bool = False) -> None:
        """Put up the pieces of lines that fit.

        Args:
            kind: of all pieces.
            ends: (N, 2, 2) m of the pieces.
            run: (N,) number of the line that they belong to.
            bulky: as of `put`.
        """
        along = ends[:, 1] - ends[:, 0]
        length = exact.hypot(along[:, 0], along[:, 1])
        radius = _half_m(kind)
        each = np.maximum(np.ceil(length / (2 * radius)), 1).astype(np.int64)
        owner = np.repeat(np.arange(len(ends)), each)
        share = (np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each) + 0.5) / each[owner]
        layers = np.full(len(owner), _layers(kind, bulky=bulky))
        discs = Discs(ends[owner, 0] + share[:, None] * along[owner], np.full(len(owner), 1.1 * radius), layers)
        fits = np.flatnonzero(self._settle(discs, each, np.full(len(ends), -1), run))
        line: list[list[float]] = []
        for n, after in zip(fits.tolist(), [*fits.tolist(), -1][1:], strict=True):
            line = line or [_rounded(ends[n, 0])]
            line.append(_rounded(ends[n, 1]))
            if after < 0 or run[after] != run[n] or not np.array_equal(ends[after, 0], ends[n, 1]):
                straight = [point for k, point in enumerate(line) if k in (0, len(line) - 1) or not _between(line, k)]
                self.entries.append({"kind": kind, "along": straight})
                line = []

    def _settle(self, discs: Discs, each: Ints, choice: Ints, run: Ints) -> Mask:
        wishes = Wishes(discs, np.concatenate([[0], np.cumsum(each)]), choice, run)
        fits = settle(wishes, self._obstacles, self._standing, _GAP_M)
        kept = np.repeat(fits, each)
        self._standing = Discs(
            *(np.concatenate([old, new[kept]]) for old, new in zip(self._standing, discs, strict=True))
        )
        return fits

    def _discs(self, kind: str, stands: Floats, *, bulky: bool, sizes: Floats | None) -> tuple[Discs, Ints]:
        """Return the discs that pieces cover, and their number (N,) for each."""
        length, width = KINDS[kind].ground_m
        longest, shortest = max(length, width), min(length, width)
        count = int(np.ceil(longest / shortest - 1e-6))
        radius = exact.hypot(shortest, longest / count) / 2
        offsets = ((np.arange(count) + 0.5) / count - 0.5) * longest
        local = np.zeros((count, 2))
        local[:, 0 if length > width else 1] = offsets
        radii, layers = np.full(count, radius), np.full(count, _layers(kind, bulky=bulky))
        if kind in ("tree", "lamp"):
            local = np.vstack([local, [[_HEAD_AHEAD_M if kind == "lamp" else 0.0, 0.0]]])
            radii, layers = np.append(radii, _LAMP_HEAD_M), np.append(layers, CROWN)
        cos, sin = exact.cos(stands[:, 2, None]), exact.sin(stands[:, 2, None])
        turned = np.stack([local[:, 0] * cos - local[:, 1] * sin, local[:, 0] * sin + local[:, 1] * cos], axis=-1)
        all_radii = np.tile(radii, (len(stands), 1))
        if kind == "tree" and sizes is not None:
            all_radii[:, -1] = sizes[:, 1] / 2 - 0.2
        middles = (stands[:, None, :2] + turned).reshape(-1, 2)
        return Discs(middles, all_radii.ravel(), np.tile(layers, len(stands))), np.full(len(stands), len(radii))


def _layers(kind: str, *, bulky: bool) -> int:
    """Return the layers that a piece stands in."""
    return GROUND | (BULKY if bulky else 0) | (0 if kind in _IN_YARDS else UNPAVED)


def _half_m(kind: str) -> float:
    """Return half the thickness of a kind along a line, or a little more of thin ones."""
    return max(KINDS[kind].ground_m[1] / 2, 0.2)


def _rounded(point: Floats) -> list[float]:
    return [float(value) for value in np.round(point, 3)]


def _between(line: list[list[float]], k: int) -> bool:
    """Return whether a point of a line is, to a millimetre, on the straight line between its neighbours."""
    (ax, ay), (bx, by), (cx, cy) = line[k - 1], line[k], line[k + 1]
    return bool(abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) < 1e-3 * exact.hypot(cx - ax, cy - ay))
