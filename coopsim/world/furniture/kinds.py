"""Kinds of furniture: models and sizes, and how many of each streets have, at which distance from the kerb.

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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coopsim.world.furniture import models
from coopsim.world.furniture.foliage import bush, hedge, tree
from coopsim.world.furniture.solids import Piece


@dataclass(frozen=True, slots=True)
class Size:
    """Usual, least and largest value of a size that may be given, m."""

    usual: float
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of furniture.

    Attributes:
        build: makes the model from the sizes, in their order, and a variant (int >= 0); for kinds along a line, the
            length of a piece comes first.
        ground_m: extents on the ground ahead and across; across alone for kinds along a line.
        sizes: sizes that may be given, by name.
        step_m: longest piece of kinds along a line; 0: the kind stands at a point.
    """

    build: Callable[..., Piece]
    ground_m: tuple[float, float]
    sizes: Mapping[str, Size] = field(default_factory=dict)
    step_m: float = 0.0

    @property
    def along(self) -> bool:
        """True if the kind stands along a line."""
        return self.step_m > 0


def _height(usual: float, least: float, most: float) -> dict[str, Size]:
    return {"height_m": Size(usual, least, most)}


KINDS: dict[str, Kind] = {
    "lamp": Kind(models.lamp, (0.2, 0.2), _height(8.0, 3.0, 15.0)),
    "sign": Kind(models.sign, (0.15, 0.1), _height(2.85, 1.0, 6.0)),
    "traffic_light": Kind(models.traffic_light, (0.3, 0.3), _height(3.3, 2.0, 6.0)),
    "bollard": Kind(models.bollard, (0.2, 0.2), _height(1.0, 0.4, 1.5)),
    "marker": Kind(models.marker, (0.15, 0.15), _height(1.0, 0.5, 1.5)),
    "hydrant": Kind(models.hydrant, (0.3, 0.45), _height(0.85, 0.5, 1.5)),
    "bench": Kind(models.bench, (0.6, 1.8)),
    "cafe_table": Kind(models.cafe_table, (1.9, 0.8)),
    "parasol": Kind(models.parasol, (0.5, 0.5)),
    "shelter": Kind(models.shelter, (1.5, 3.8)),
    "market_stall": Kind(models.market_stall, (2.2, 3.2)),
    "bicycle_rack": Kind(models.bicycle_rack, (0.8, 2.5)),
    "bin": Kind(models.bin_of_litter, (0.54, 0.54)),
    "dustbins": Kind(models.dustbins, (0.8, 1.3)),
    "mailbox": Kind(models.mailbox, (0.45, 0.6)),
    "cabinet": Kind(models.cabinet, (0.4, 1.7)),
    "recycling": Kind(models.recycling, (1.3, 4.2)),
    "planter": Kind(models.planter, (0.95, 1.4)),
    "advertising_column": Kind(models.advertising_column, (1.45, 1.45)),
    "skip": Kind(models.skip, (2.1, 3.2)),
    "heap": Kind(models.heap, (2.5, 2.5), {"width_m": Size(2.5, 0.5, 10.0), "height_m": Size(1.1, 0.2, 5.0)}),
    "trailer": Kind(models.trailer, (4.6, 2.2)),
    "pole": Kind(models.pole, (0.3, 0.3), _height(8.0, 4.0, 14.0)),
    "tree": Kind(
        tree,
        (0.4, 0.4),
        {"height_m": Size(9.0, 2.0, 40.0), "crown_m": Size(5.0, 0.5, 25.0), "stem_m": Size(3.0, 0.5, 20.0)},
    ),
    "bush": Kind(bush, (1.2, 1.2), {"height_m": Size(1.2, 0.3, 4.0), "width_m": Size(1.3, 0.3, 6.0)}),
    "hedge": Kind(hedge, (0.0, 0.8), {"height_m": Size(1.4, 0.3, 5.0), "thickness_m": Size(0.8, 0.3, 3.0)}, step_m=4.0),
    "fence": Kind(models.fence, (0.0, 0.1), _height(1.1, 0.4, 3.0), step_m=4.0),
    "railing": Kind(models.railing, (0.0, 0.1), _height(1.0, 0.4, 2.0), step_m=4.0),
    "crash_barrier": Kind(models.crash_barrier, (0.0, 0.3), _height(0.75, 0.4, 1.5), step_m=12.0),
    "concrete_barrier": Kind(models.concrete_barrier, (0.0, 0.6), _height(0.85, 0.4, 1.5), step_m=4.0),
    "work_fence": Kind(models.work_fence, (0.0, 0.6), _height(1.0, 0.6, 1.5), step_m=2.0),
    "garden_wall": Kind(models.garden_wall, (0.0, 0.3), _height(1.2, 0.4, 3.0), step_m=4.0),
    "scaffold": Kind(models.scaffold, (0.0, 1.0), _height(6.9, 2.0, 30.0), step_m=2.5),
}
"""All kinds, by name."""


@lru_cache(1024)
def model(kind: str, sizes_m: tuple[float, ...], variant: int) -> Piece:
    """Return a kind's model; `sizes_m` are those of `Kind.build`."""
    return KINDS[kind].build(*sizes_m, variant)


class Row(NamedTuple):
    """Pieces of one kind at intervals along one side of a street.

    Attributes:
        kind: kind of the pieces.
        every_m: mean distance between two on one side.
        first_m: least distance of the middle from the edge of the lanes, or from the line where people walk.
        facing_rad: direction in which pieces look, counter-clockwise from the direction of traffic, or (behind people's
            way) from the direction towards the way.
        share: share of sides that have the row.
        jitter: share of `every_m` by which pieces are shifted at random.
        bulky: hides people who are about to cross: not close to crosswalks and stop lines.
        fills: put up last, where there is space.
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


class Run(NamedTuple):
    """Runs of a kind that stands along a line; see `Row`.

    A run begins every `every_m` on average; the shortest and the longest are `run_m`.
    """

    kind: str
    every_m: float
    run_m: tuple[float, float]
    first_m: float
    share: float
    bulky: bool = False


KERB_LINES = (Run("railing", 120.0, (6.0, 12.0), 0.55, 0.25), Run("work_fence", 400.0, (6.0, 12.0), 0.8, 0.7))
BACK_LINES = (
    Run("hedge", 36.0, (8.0, 22.0), 1.5, 0.3, bulky=True),
    Run("fence", 34.0, (8.0, 24.0), 1.3, 0.3),
    Run("concrete_barrier", 400.0, (8.0, 16.0), 1.5, 0.5),
)
VERGE_LINES = (Run("crash_barrier", 150.0, (48.0, 84.0), 1.2, 1.0),)

CROSSING_LIGHTS = 0.35
"""Share of crosswalks with traffic lights; the others have signs. Ours."""

SCAFFOLDS, CAFES = 0.05, 0.12
"""Shares of a building's sides along people's ways that have a scaffold, or tables of a café. Ours."""

TREE_SIZES_M = ((7.0, 4.0), (8.0, 4.5), (9.0, 5.0), (10.0, 5.5), (11.0, 6.0))
"""Heights and widths of crowns of trees."""

STREET_STEM_M, YARD_STEM_M = 4.3, 2.2
"""Heights at which crowns begin: above trucks in streets, lower elsewhere."""
