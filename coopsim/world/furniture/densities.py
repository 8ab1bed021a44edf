"""How much furniture and how many plants streets have, and where across the street they stand.

| kind | here, along a street | source |
|---|---|---|
| lamp | every 30 m, on alternate sides | 2.5 to 3 times their height of 8 to 12 m: Global Street Design Guide (NACTO) |
| tree | 11 m apart, on 3 of 10 sides | Healthy Streets for Surrey, 7.4: 8 to 16 m |
| sign | every 40 m | Dutch towns: one every 55 m, 22 to 25 m in the densest (HR Groep Streetcare 2021) |
| hydrant | every 120 m | 300 to 500 feet: codes of the USA |
| bench | every 60 m | 30 to 60 m on busy, 90 to 120 m on quiet ways; 50 m: Inclusive Mobility (UK) |
| shelter | every 400 m on each side | stops 250 to 800 m apart: NZ Transport Agency |
| marker (verge) | every 50 m on each side | German motorways and roads |
| all others | see below | ours |

Posts stand 0.45 m and more from the kerb: Healthy Streets for Surrey, 9.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """Pieces of one kind at intervals along one side of a street.

    Attributes:
        kind: of the pieces.
        every_m: mean distance between two on one side.
        first_m: least distance of the middle from the edge of the lanes, or from the line where people walk.
        facing_rad: direction in which pieces look, to the left of the direction of traffic; of those behind people's
            way, of the direction towards it.
        share: of the sides that have the row.
        jitter: share of `every_m` by which pieces are shifted at random.
        bulky: hides people who are about to cross: not close to crosswalks and stop lines.
        fills: is put up last, where there is room.
        group: pieces next to each other in one place, `apart_m` from middle to middle.
        apart_m: see `group`.
    """

    kind: str
    every_m: float
    first_m: float
    facing_rad: float = 0.0
    share: float = 1.0
    jitter: float = 0.3
    bulky: bool = False
    fills: bool = False
    group: int = 1
    apart_m: float = 0.0


_ROAD, _AWAY, _ONCOMING = np.pi / 2, -np.pi / 2, np.pi

KERB = (
    Row("lamp", 60.0, 0.6, _ROAD, jitter=0.05),
    Row("sign", 80.0, 0.6, _ONCOMING),
    Row("tree", 11.0, 0.75, share=0.3, jitter=0.1),
    Row("hydrant", 150.0, 0.9, _ROAD),
    Row("bench", 120.0, 0.85, _AWAY),
    Row("bin", 120.0, 0.8, _AWAY),
    Row("bicycle_rack", 240.0, 0.9, _ROAD, share=0.7),
    Row("mailbox", 500.0, 0.75, _AWAY),
    Row("planter", 120.0, 1.0, _ROAD, share=0.4, fills=True, group=2, apart_m=2.6),
    Row("bollard", 150.0, 0.6, _ROAD, share=0.5, group=4, apart_m=1.5),
    Row("advertising_column", 500.0, 1.3, _ROAD, bulky=True),
    Row("recycling", 500.0, 1.2, _AWAY, bulky=True),
)
"""Between the lanes and people's way, or behind a strip where vehicles park."""

BACK = (
    Row("shelter", 400.0, 1.85, bulky=True),
    Row("cabinet", 120.0, 1.2),
    Row("dustbins", 60.0, 1.4, share=0.5, fills=True),
    Row("tree", 30.0, 3.2, share=0.2, fills=True),
    Row("bush", 30.0, 1.7, share=0.5, fills=True, group=2, apart_m=1.7),
    Row("bench", 200.0, 1.4, fills=True),
    Row("recycling", 500.0, 1.8, bulky=True),
    Row("heap", 500.0, 2.5, bulky=True),
    Row("skip", 600.0, 2.2, np.pi / 2, bulky=True),
    Row("trailer", 400.0, 2.4, np.pi / 2, bulky=True),
    Row("market_stall", 600.0, 2.2, bulky=True, group=3, apart_m=3.8),
)
"""Behind people's way, seen from the road."""

VERGE = (
    Row("marker", 50.0, 0.6, _ONCOMING, jitter=0.0),
    Row("sign", 250.0, 1.6, _ONCOMING),
    Row("bush", 50.0, 5.5, jitter=0.45, fills=True, group=2, apart_m=2.0),
    Row("tree", 75.0, 7.5, jitter=0.45, fills=True),
    Row("cabinet", 800.0, 3.0, _ROAD),
)
"""Beside roads where nobody walks."""


class Line(NamedTuple):
    """Runs of a kind that stands along a line.

    Attributes:
        kind: of the runs.
        every_m: mean distance from the beginning of a run to that of the next.
        run_m: shortest and longest run.
        first_m: as of `Row`.
        share: of the sides that have runs.
        bulky: as of `Row`.
    """

    kind: str
    every_m: float
    run_m: tuple[float, float]
    first_m: float
    share: float
    bulky: bool = False


KERB_LINES = (Line("railing", 120.0, (6.0, 12.0), 0.55, 0.25), Line("work_fence", 400.0, (6.0, 12.0), 0.8, 0.7))
BACK_LINES = (
    Line("hedge", 36.0, (8.0, 22.0), 1.5, 0.3, bulky=True),
    Line("fence", 34.0, (8.0, 24.0), 1.3, 0.3),
    Line("concrete_barrier", 400.0, (8.0, 16.0), 1.5, 0.5),
)
VERGE_LINES = (Line("crash_barrier", 150.0, (48.0, 84.0), 1.2, 1.0),)

CROSSING_LIGHTS = 0.35
"""Share of crosswalks with traffic lights; the others have signs. Ours."""

SCAFFOLDS, CAFES = 0.05, 0.12
"""Shares of a building's sides along people's ways that have a scaffold, or tables of a café. Ours."""

TREE_SIZES_M = ((7.0, 4.0), (8.0, 4.5), (9.0, 5.0), (10.0, 5.5), (11.0, 6.0))
"""Heights and widths of crowns of trees."""

STREET_STEM_M, YARD_STEM_M = 4.3, 2.2
"""Heights at which crowns begin: above trucks in streets, lower elsewhere."""
