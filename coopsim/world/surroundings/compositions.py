"""Compositions: what stands together in real streets, beside people's ways, at kerbs, and at walls.

Each function puts furniture and bystanders into a `Draft`, with y = 0 nearest to the line that it stands beside. Sizes
and numbers are ours, after a look at a few real sweeps. How often a composition is chosen stands in the tables below.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coopsim.geometry import exact
from coopsim.world.surroundings.draft import ALONG, BACK, IN, OUT, Draft

Composition = Callable[[Draft], None]

_STEM_M, _CROWN_M = (1.5, 2.5), (3.0, 6.0)
_LINES = (("hedge", 0.8, 2.0), ("fence", 0.8, 1.8), ("garden_wall", 0.6, 1.8))


def under_tree(draft: Draft) -> None:
    """Plant a tree whose crown hangs low over people who stand below."""
    draft.tree(0.0, 1.3, _STEM_M, _CROWN_M)
    _around(draft, 0.0, 1.3, int(draft.rng.integers(1, 5)), (0.7, 1.6))
    if draft.rng.random() < 0.4:
        draft.piece("bush", draft.rng.uniform(-2.0, 2.0), 2.6, height_m=0.8, width_m=1.0)


def group(draft: Draft) -> None:
    """Let two to five people stand together and look at each other."""
    count = int(draft.rng.integers(2, 6))
    _ring(draft, 0.0, 1.0, count, 0.25 + 0.15 * count)


def behind_line(draft: Draft) -> None:
    """Build a hedge, a fence or a wall with people before and behind it, and plants behind it."""
    kind, low_m, high_m = _LINES[int(draft.rng.integers(len(_LINES)))]
    height_m = round(10 * draft.rng.uniform(low_m, high_m)) / 10
    draft.line(kind, 0.0, 1.1, float(draft.rng.integers(2, 4) * 4), height_m=height_m)
    for y, count in ((0.4, draft.rng.integers(0, 3)), (1.9, draft.rng.integers(1, 3))):
        for _ in range(count):
            draft.person(draft.rng.uniform(-3.5, 3.5), y + draft.rng.uniform(0.0, 0.3), _any(draft))
    for _ in range(draft.rng.integers(0, 3)):
        draft.piece("bush", draft.rng.uniform(-3.5, 3.5), 2.8, height_m=1.2, width_m=1.3)


def garden(draft: Draft) -> None:
    """Plant bushes and a tree around people, behind a low fence, hedge or wall."""
    kind, low_m, _ = _LINES[int(draft.rng.integers(len(_LINES)))]
    draft.line(kind, 0.0, 0.6, 8.0, height_m=low_m)
    draft.tree(draft.rng.uniform(-2.5, 2.5), 3.2, _STEM_M, (2.5, 4.5))
    for _ in range(draft.rng.integers(1, 4)):
        draft.person(draft.rng.uniform(-3.5, 3.5), draft.rng.uniform(1.5, 4.0), _any(draft))
    for _ in range(draft.rng.integers(2, 6)):
        width_m = round(2 * draft.rng.uniform(0.8, 1.7)) / 2
        x, y = draft.rng.uniform(-3.8, 3.8), draft.rng.uniform(1.4, 4.5)
        draft.piece("bush", x, y, height_m=width_m, width_m=width_m)


def bench(draft: Draft) -> None:
    """Put up a bench, with people who sit on it, a bin, and often a tree behind."""
    draft.piece("bench", 0.0, 0.7)
    for x in (-0.6, 0.0, 0.6):
        if draft.rng.random() < 0.6:
            draft.sitter(x, 0.75, IN)
    draft.piece("bin", 1.5, 0.7)
    if draft.rng.random() < 0.6:
        draft.tree(draft.rng.uniform(-1.0, 1.0), 1.6, _STEM_M, _CROWN_M)
    if draft.rng.random() < 0.4:
        draft.person(-1.5, 0.6, ALONG)


def cafe(draft: Draft) -> None:
    """Put up tables with people who sit at them, planters beside, and somebody who serves."""
    for x in 2.7 * np.arange(int(draft.rng.integers(2, 5))):
        draft.piece("cafe_table", x, 0.8, ALONG)
        for side, turn in ((-0.7, ALONG), (0.7, BACK)):
            if draft.rng.random() < 0.7:
                draft.sitter(x + side, 0.8, turn)
        if draft.rng.random() < 0.4:
            draft.person(x, 1.7, IN)
    draft.piece("planter", -2.0, 0.8)


def racks(draft: Draft) -> None:
    """Put up a rack with bicycles and scooters, and people beside it."""
    draft.piece("bicycle_rack", 0.0, 1.2, IN)
    for x in (-1.45, -0.95, -0.65, -0.15, 0.15, 0.65, 0.95, 1.45):
        if draft.rng.random() < 0.6:
            turn = IN if draft.rng.random() < 0.5 else OUT
            draft.cycle(x, 1.2 + draft.rng.uniform(-0.1, 0.1), turn + draft.rng.uniform(-0.1, 0.1), on_rack=True)
    for x in (-2.2, 2.3):
        if draft.rng.random() < 0.4:
            draft.person(x, draft.rng.uniform(0.6, 1.6), _any(draft))


def stop(draft: Draft) -> None:
    """Put up a shelter, with people who wait and sit in it and beside it."""
    draft.piece("shelter", 0.0, 1.0, IN, bulky=True)
    for x in (-0.8, -0.1, 0.6):
        if draft.rng.random() < 0.5:
            draft.sitter(x, 1.25, IN)
    for x in np.arange(-2.4, 5.0, 0.9):
        if (x < -2.0 or x > 2.0) and draft.rng.random() < 0.6:
            draft.person(x, draft.rng.uniform(0.5, 1.3), IN + draft.rng.normal(0.0, 0.6))
    draft.piece("sign", 2.3, 0.4, BACK)


def parked_by_hedge(draft: Draft) -> None:
    """Park a car on private ground, in or out, between hedges and under a tree, with somebody beside it."""
    draft.vehicle(0.0, 3.0, _in_or_out(draft))
    for x in (-1.8, 1.8):
        if draft.rng.random() < 0.6:
            kind, low_m, high_m = _LINES[int(draft.rng.integers(len(_LINES)))]
            draft.line(kind, x, 3.0, 4.0, OUT, height_m=round(10 * draft.rng.uniform(low_m, high_m)) / 10)
    if draft.rng.random() < 0.6:
        draft.tree(draft.rng.choice((-1.7, 1.7)), draft.rng.uniform(1.5, 5.8), (1.5, 3.0), _CROWN_M)
    for x in (-1.4, 1.4):
        if draft.rng.random() < 0.35:
            draft.person(x, draft.rng.uniform(1.2, 4.5), _any(draft))


def lot(draft: Draft) -> None:
    """Park a row of cars side by side, in or out, with people between them."""
    count = int(draft.rng.integers(3, 7))
    for x in 2.7 * np.arange(count):
        if draft.rng.random() < 0.85:
            draft.vehicle(x, 3.0 + draft.rng.uniform(-0.3, 0.3), _in_or_out(draft) + draft.rng.normal(0.0, 0.03))
        if draft.rng.random() < 0.3:
            draft.person(x + 1.35, draft.rng.uniform(1.5, 4.5), draft.rng.choice((IN, OUT)))


def kerb_tree(draft: Draft) -> None:
    """Plant a tree at the kerb, whose low crown hangs over what is parked and who stands there."""
    draft.tree(0.0, 0.4, _STEM_M, (2.0, 5.5))
    for x in (-1.6, -0.9, 0.9, 1.6):
        if draft.rng.random() < 0.35:
            draft.person(x, 0.4, _any(draft))


def waiting(draft: Draft) -> None:
    """Let up to four people wait at the kerb, side by side, beside a pole, a bin or bollards."""
    for x in 0.75 * np.arange(int(draft.rng.integers(1, 5))):
        draft.person(x, 0.45, IN + draft.rng.normal(0.0, 0.5))
    kind = ("pole", "bin", "bollard", "sign", "cabinet")[int(draft.rng.integers(5))]
    draft.piece(kind, -0.9, 0.4, BACK if kind == "sign" else IN)
    if kind == "bollard":
        draft.piece(kind, -2.4, 0.4)


def leant_cycles(draft: Draft) -> None:
    """Lean one or two bicycles on a pole at the kerb."""
    draft.piece("pole" if draft.rng.random() < 0.5 else "sign", 0.0, 0.4, BACK)
    for x in (-1.2, 1.2):
        if draft.rng.random() < 0.7:
            draft.cycle(x, 0.42, draft.rng.choice((ALONG, BACK)) + draft.rng.normal(0.0, 0.05))


def at_wall(draft: Draft) -> None:
    """Let people stand with their backs at a wall, or in pairs before it."""
    x = 0.0
    for _ in range(draft.rng.integers(1, 4)):
        draft.person(x, 0.45, OUT + draft.rng.normal(0.0, 0.4))
        if draft.rng.random() < 0.35:
            draft.person(x + draft.rng.uniform(-0.2, 0.2), 1.25, IN)
        x += draft.rng.uniform(0.7, 1.6)
    if draft.rng.random() < 0.4:
        draft.cycle(x + 1.2, 0.45, draft.rng.choice((ALONG, BACK)))
    if draft.rng.random() < 0.2:
        draft.piece("dustbins", -1.4, 0.6, OUT)


def _around(draft: Draft, x: float, y: float, count: int, radius_m: tuple[float, float]) -> None:
    """Let people stand around a point, at most a little nearer to the line than it."""
    for angle in draft.rng.uniform(0.0, 2 * np.pi, count):
        away = draft.rng.uniform(*radius_m)
        at = max(y + away * float(exact.sin(angle)), 0.3)
        draft.person(x + away * float(exact.cos(angle)), at, _any(draft))


def _ring(draft: Draft, x: float, y: float, count: int, radius_m: float) -> None:
    start = draft.rng.uniform(0.0, 2 * np.pi)
    for angle in start + 2 * np.pi * np.arange(count) / count + draft.rng.normal(0.0, 0.15, count):
        at = x + radius_m * float(exact.cos(angle)), y + radius_m * float(exact.sin(angle))
        draft.person(*at, float(angle) + np.pi + draft.rng.normal(0.0, 0.3))


def _any(draft: Draft) -> float:
    return float(draft.rng.uniform(-np.pi, np.pi))


def _in_or_out(draft: Draft) -> float:
    return IN if draft.rng.random() < 0.5 else OUT


BEHIND_WAYS: tuple[tuple[Composition, float], ...] = (
    (under_tree, 0.20),
    (group, 0.08),
    (behind_line, 0.14),
    (garden, 0.12),
    (bench, 0.08),
    (cafe, 0.06),
    (racks, 0.09),
    (stop, 0.04),
    (parked_by_hedge, 0.12),
    (lot, 0.07),
)
AT_KERBS: tuple[tuple[Composition, float], ...] = ((kerb_tree, 0.5), (waiting, 0.3), (leant_cycles, 0.2))
AT_WALLS: tuple[tuple[Composition, float], ...] = ((at_wall, 1.0),)
"""Compositions of each zone, with how often each is tried."""
