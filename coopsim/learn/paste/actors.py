"""Actors to paste: what they are, and where they stand on free ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.clips.realism import Realism, draw_realism
from coopsim.learn.paste.free_ground import FreeGround
from coopsim.sensors.scene import SceneGeometry, Triangles
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import draw_models, make_models, models_of
from coopsim.world.models.model import Model
from coopsim.world.models.paint import draw_colors
from coopsim.world.snapshot import Actors

_SHARES = {
    ObjectClass.CAR: 0.42,
    ObjectClass.VAN: 0.07,
    ObjectClass.TRUCK: 0.07,
    ObjectClass.BUS: 0.03,
    ObjectClass.MOTORCYCLE: 0.06,
    ObjectClass.BICYCLE: 0.08,
    ObjectClass.SCOOTER: 0.03,
    ObjectClass.PEDESTRIAN: 0.19,
    ObjectClass.CHILD: 0.05,
}
_FASTEST_M_S = {ObjectClass.PEDESTRIAN: 1.8, ObjectClass.CHILD: 1.8, ObjectClass.BICYCLE: 6.0, ObjectClass.SCOOTER: 6.0}
_FASTEST_OTHERS_M_S, _STANDING_SHARE = 12.0, 0.5
_NEAREST_M, _TRIES = 4.0, 40


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Frame of a sweep into which actors are pasted.

    Attributes:
        first_SE3_base: pose of its base frame in that of the window's first frame.
        time_s: since the window's first frame.
        ground: its ground.
        origin_m: (3,) place of its sensor.
    """

    first_SE3_base: SE3
    time_s: float
    ground: FreeGround
    origin_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PlacedActors:
    """A actors in the frames of a window.

    Attributes:
        actors: at the origin, with their sizes.
        scale: (A, 3) factors on their models.
        boxes: (F, A, 7) boxes in the base frame of each frame.
        realism: their paint.
    """

    actors: Actors
    scale: Floats
    boxes: Floats
    realism: Realism

    def triangles(self, frame: int) -> Triangles:
        """Return the actors' surfaces in the base frame of a frame."""
        there = self.actors.moved(
            np.arange(len(self.actors)), Boxes3D.from_array(self.boxes[frame]), self.actors.velocity
        )
        return self.realism.painted(SceneGeometry(_models(), []).triangles(there, self.scale), there)


@cache
def _models() -> tuple[Model, ...]:
    return make_models(varied=True)


def place_actors(stages: Sequence[Stage], count: int, reach_m: float, seed: int) -> PlacedActors:
    """Draw `count` actors and place them on free ground within `reach_m` of the first sensor; those that fit stay.

    Half of them stand, the others go straight on. Ground where they stand is taken from `stages` for those that follow.
    """
    rng = stream(seed, "placed actors")
    actors, realism = _draw(count, seed, rng), draw_realism(seed, 0)
    sized, scale = realism.sized(actors, np.zeros(count, np.bool_))
    kept, boxes = list[int](), list[Floats]()
    for number, (size, label) in enumerate(zip(sized.boxes.size, sized.label.tolist(), strict=True)):
        placed = _place(stages, size, _FASTEST_M_S.get(ObjectClass(label), _FASTEST_OTHERS_M_S), reach_m, rng)
        if placed is not None:
            kept.append(number)
            boxes.append(placed)
            for stage, box in zip(stages, placed, strict=True):
                stage.ground.take(box)
    rows: Ints = np.array(kept, np.int64)
    placed_boxes = np.array(boxes).reshape(-1, len(stages), 7).swapaxes(0, 1)
    return PlacedActors(sized[rows], scale[rows], placed_boxes, realism)


def _draw(count: int, seed: int, rng: np.random.Generator) -> Actors:
    """Draw actors that stand at the origin."""
    models, ids = _models(), np.arange(1, count + 1)
    label = rng.choice([int(each) for each in _SHARES], count, p=list(_SHARES.values()))
    model = np.array(
        [draw_models(rng, models, models_of(models, ObjectClass(each)), 1)[0] for each in label.tolist()], np.int64
    )
    size = np.array([models[k].size_m for k in model.tolist()]).reshape(-1, 3)
    center = np.column_stack([np.zeros((count, 2)), size[:, 2] / 2])
    color, accent = draw_colors(seed, ids, label, dirty=True)
    boxes = Boxes3D(center, size, np.zeros(count))
    return Actors(ids, boxes, np.zeros((count, 2)), label, model, color, accent, rng.random(count))


def _place(
    stages: Sequence[Stage], size: Floats, fastest_m_s: float, reach_m: float, rng: np.random.Generator
) -> Floats | None:
    """Return boxes (F, 7) of one actor that fits in all frames; None: none of some tries does."""
    away_m, bearing, yaw, speed = rng.random((4, _TRIES))
    away_m = _NEAREST_M + size[0] / 2 + away_m * (reach_m - _NEAREST_M - size[0] / 2)
    bearing, yaw = 2 * np.pi * bearing, 2 * np.pi * yaw - np.pi
    speed = np.maximum(speed - _STANDING_SHARE, 0.0) / (1 - _STANDING_SHARE) * fastest_m_s
    spots = stages[0].origin_m[:2] + away_m[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    for spot, heading, way_m_s in zip(spots, yaw, speed, strict=True):
        boxes = np.array([_box_in(stage, spot, size, heading, way_m_s) for stage in stages])
        if all(stage.ground.fits(box) for stage, box in zip(stages, boxes, strict=True)):
            return boxes
    return None


def _box_in(stage: Stage, spot: Floats, size: Floats, yaw: float, speed_m_s: float) -> Floats:
    """Return the box (7,) in a frame of an actor that begins at a spot (2,) of the first and goes straight on."""
    there = spot + speed_m_s * stage.time_s * np.array([np.cos(yaw), np.sin(yaw)])
    base_SE3_first = stage.first_SE3_base.inverse()
    x, y, _ = base_SE3_first.apply(np.array([[*there, 0.0]]))[0]
    z = float(stage.ground.heights(np.array([[x, y]]))[0]) + size[2] / 2
    return np.array([x, y, z, *size, yaw + base_SE3_first.yaw])
