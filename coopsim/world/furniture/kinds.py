"""The kinds of furniture by name: models, sizes, and the ground that they need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from coopsim.world.furniture import containers, fences, plants, posts, seats, works
from coopsim.world.furniture.piece import Piece


@dataclass(frozen=True, slots=True)
class Size:
    """A size that may be given.

    Attributes:
        usual: m.
        least: m.
        most: m.
    """

    usual: float
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of furniture.

    Attributes:
        build: makes the model from the sizes, in their order, and a variant (int >= 0); of kinds along a line from the
            length of a piece first.
        ground_m: extents on the ground ahead and across; across alone for kinds along a line.
        sizes: what may be given, by name.
        step_m: longest piece of kinds along a line; 0: the kind stands at a point.
    """

    build: Callable[..., Piece]
    ground_m: tuple[float, float]
    sizes: Mapping[str, Size] = field(default_factory=dict)
    step_m: float = 0.0

    @property
    def along(self) -> bool:
        """Whether the kind stands along a line."""
        return self.step_m > 0


def _height(usual: float, least: float, most: float) -> dict[str, Size]:
    return {"height_m": Size(usual, least, most)}


KINDS: dict[str, Kind] = {
    "lamp": Kind(posts.lamp, (0.2, 0.2), _height(8.0, 3.0, 15.0)),
    "sign": Kind(posts.sign, (0.15, 0.1), _height(2.85, 1.0, 6.0)),
    "traffic_light": Kind(posts.traffic_light, (0.3, 0.3), _height(3.3, 2.0, 6.0)),
    "bollard": Kind(posts.bollard, (0.2, 0.2), _height(1.0, 0.4, 1.5)),
    "marker": Kind(posts.marker, (0.15, 0.15), _height(1.0, 0.5, 1.5)),
    "hydrant": Kind(posts.hydrant, (0.3, 0.45), _height(0.85, 0.5, 1.5)),
    "bench": Kind(seats.bench, (0.6, 1.8)),
    "cafe_table": Kind(seats.cafe_table, (1.9, 0.8)),
    "parasol": Kind(seats.parasol, (0.5, 0.5)),
    "shelter": Kind(seats.shelter, (1.5, 3.8)),
    "market_stall": Kind(seats.market_stall, (2.2, 3.2)),
    "bicycle_rack": Kind(seats.bicycle_rack, (0.8, 2.5)),
    "bin": Kind(containers.bin_of_litter, (0.54, 0.54)),
    "dustbins": Kind(containers.dustbins, (0.8, 1.3)),
    "mailbox": Kind(containers.mailbox, (0.45, 0.6)),
    "cabinet": Kind(containers.cabinet, (0.4, 1.7)),
    "recycling": Kind(containers.recycling, (1.3, 4.2)),
    "planter": Kind(containers.planter, (0.95, 1.4)),
    "advertising_column": Kind(containers.advertising_column, (1.45, 1.45)),
    "skip": Kind(containers.skip, (2.1, 3.2)),
    "heap": Kind(works.heap, (2.5, 2.5), {"width_m": Size(2.5, 0.5, 10.0), "height_m": Size(1.1, 0.2, 5.0)}),
    "trailer": Kind(works.trailer, (4.6, 2.2)),
    "tree": Kind(
        plants.tree,
        (0.4, 0.4),
        {"height_m": Size(9.0, 2.0, 40.0), "crown_m": Size(5.0, 0.5, 25.0), "stem_m": Size(3.0, 0.5, 20.0)},
    ),
    "bush": Kind(plants.bush, (1.2, 1.2), {"height_m": Size(1.2, 0.3, 4.0), "width_m": Size(1.3, 0.3, 6.0)}),
    "hedge": Kind(
        plants.hedge, (0.0, 0.8), {"height_m": Size(1.4, 0.3, 5.0), "thickness_m": Size(0.8, 0.3, 3.0)}, step_m=4.0
    ),
    "fence": Kind(fences.fence, (0.0, 0.1), _height(1.1, 0.4, 3.0), step_m=4.0),
    "railing": Kind(fences.railing, (0.0, 0.1), _height(1.0, 0.4, 2.0), step_m=4.0),
    "crash_barrier": Kind(fences.crash_barrier, (0.0, 0.3), _height(0.75, 0.4, 1.5), step_m=12.0),
    "concrete_barrier": Kind(fences.concrete_barrier, (0.0, 0.6), _height(0.85, 0.4, 1.5), step_m=4.0),
    "work_fence": Kind(fences.work_fence, (0.0, 0.6), _height(1.0, 0.6, 1.5), step_m=2.0),
    "scaffold": Kind(fences.scaffold, (0.0, 1.0), _height(6.9, 2.0, 30.0), step_m=2.5),
}
"""All kinds, by name."""


@lru_cache(1024)
def model(kind: str, sizes_m: tuple[float, ...], variant: int) -> Piece:
    """Return a kind's model; `sizes_m` are those of `Kind.build`."""
    return KINDS[kind].build(*sizes_m, variant)
