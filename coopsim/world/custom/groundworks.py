"""What shapes the ground of a place, and its work on a layout."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.carriageways import carriageways
from coopsim.world.places.layout import ASPHALT, PAVEMENT, Layout
from coopsim.world.places.road_network import Road
from coopsim.world.relief.crown import crown_triangles
from coopsim.world.relief.draping import drape, laid_on
from coopsim.world.relief.humps import Hump
from coopsim.world.relief.kerbs import kerb_faces, pavement_tops
from coopsim.world.relief.relief import Relief
from coopsim.world.relief.wet_albedo import wet_albedo
from coopsim.world.snapshot import StaticPart

_ROAD_REFLECTIVITY, _PAVEMENT_REFLECTIVITY = 0.18, 0.35
_PAVING, _KERB = (104, 92, 86), (172, 170, 163)
_BESIDE = ("ground", "grass", "yard", "parking")  # surfaces below the road's
_CLOSER = 0.3  # factor on their depths: things on them stand at the height 0
_WATER_M, _PAINT_M = 0.004, 0.008  # over the road: in this order water and paint lie on it
_GAMMA = 2.2  # of colours


@dataclass(frozen=True, slots=True)
class Groundworks:
    """The shape of the ground.

    Attributes:
        kerb_m: height of the pavements over the roads.
        crown: fall of the roads from the middle to the gutters, m per m.
        humps: on the roads.
        wet: outlines (K, 2) m of water on the roads, convex, counter-clockwise.
    """

    kerb_m: float = 0.0
    crown: float = 0.0
    humps: tuple[Hump, ...] = ()
    wet: tuple[Floats, ...] = ()

    def applied(self, layout: Layout, flat: Collection[Road]) -> Layout:
        """Return a layout on this ground; flat ground changes nothing.

        Args:
            layout: on flat ground.
            flat: roads without a crown besides the layout's movements, as turning loops.
        """
        if self.kerb_m == 0 and self.crown == 0 and not self.humps and not self.wet:
            return layout
        crowned = carriageways(layout.network, {*layout.movements, *flat}) if self.crown > 0 else []
        crown = _joined([crown_triangles(*road, self.crown) for road in crowned])
        humps = _joined([hump.triangles(Relief(crown)) for hump in self.humps])
        raised = layout.road_map.pavements if self.kerb_m > 0 else ()
        tops, road = pavement_tops(raised, self.kerb_m), Relief(np.concatenate([crown, humps]))
        relief = Relief(np.concatenate([road.grid.triangles, tops]))
        parts = [
            *(_on_ground(part, road, relief) for part in layout.static if part.name != "pavement" or not raised),
            *_surface("road", crown, ASPHALT, _ROAD_REFLECTIVITY),
            *_surface("hump", humps, _PAVING, _ROAD_REFLECTIVITY),
            *_surface("pavement", tops, PAVEMENT, _PAVEMENT_REFLECTIVITY),
            *_surface("kerb", kerb_faces(raised, self.kerb_m), _KERB, _PAVEMENT_REFLECTIVITY),
            *self._water(road),
        ]
        rsus = tuple(relief.raised(unit) for unit in layout.rsus)
        return replace(layout, static=tuple(parts), rsus=rsus, relief=relief)

    def _water(self, road: Relief) -> list[StaticPart]:
        """Build the patches of water on the road."""
        flat = pavement_tops(self.wet, 0.0)[..., :2]
        laid = _lifted(drape(np.ascontiguousarray(flat), road.grid), _WATER_M)
        albedo = wet_albedo(np.array([_ROAD_REFLECTIVITY]))[0]
        light = wet_albedo(exact.settled((np.array(ASPHALT) / 255) ** _GAMMA))
        red, green, blue = np.round(255 * exact.settled(light ** (1 / _GAMMA))).astype(int).tolist()
        return _surface("water", laid, (red, green, blue), float(albedo))


def _on_ground(part: StaticPart, road: Relief, relief: Relief) -> StaticPart:
    """Return a part of flat ground as it is on this one: paint lies on the road, and masts stand where they are."""
    if part.name == "marking":
        return laid_on(part, road.grid, _PAINT_M)
    if part.name in _BESIDE:
        return replace(part, vertices=part.vertices * [1.0, 1.0, _CLOSER])
    if part.name == "mast":
        rise_m = relief.heights(part.vertices[:, :2].mean(axis=0)[None])[0]
        return replace(part, vertices=_lifted(part.vertices, float(rise_m)))
    return part


def _surface(name: str, triangles: Floats, color: tuple[int, int, int], reflectivity: float) -> list[StaticPart]:
    """Build a part of triangles (T, 3, 3) m; none of none."""
    if not len(triangles):
        return []
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return [StaticPart(name, triangles.reshape(-1, 3), faces, color, reflectivity, closed=False)]


def _lifted(points: Floats, up_m: float) -> Floats:
    lifted: Floats = points + np.array([0.0, 0.0, up_m])
    return lifted


def _joined(parts: Sequence[Floats]) -> Floats:
    return np.concatenate([np.zeros((0, 3, 3)), *parts])
