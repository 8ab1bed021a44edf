"""First sketch of a town: centres of junctions, and streets as chains of straight lines.

Junctions are places of a lattice of three by three, of which each row and column has a width of its own, sheared, and
then each moved a little. Neighbours are linked, so that streets enclose blocks; from the outer ones streets lead out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.plan import Arm

LEAST_ANGLE_RAD = math.radians(62.0)
"""Between two arms of a junction."""

_SIDE = 3  # of the lattice
_SHEAR = 0.3  # at most: 17 degrees
_JITTER = 0.07  # share of the spacing
_OMITTED = 0.12  # share of the links that are left out, where another way leads around
_BENT, _TWICE = 0.35, 0.12  # shares of links with one bend and with two
_BEND = (0.07, 0.15)  # of a link: distance aside, in lengths
_TRIALS = 24
_LOOP_ROOM_M, _ROOM_M, _OWN_M = 36.0, 30.0, 42.0  # around a loop, around a street, and where streets may be closer
_OUTER_BENT = 0.5
_OUTER_TURN_RAD = (math.radians(12.0), math.radians(55.0))


@dataclass(slots=True)
class Link:
    """Line of a street through points (K, 2) m, from junction `begin` to junction `end`, or to a loop if it is None."""

    points: Floats
    begin: int
    end: int | None


@dataclass(slots=True)
class Sketch:
    """Centres of junctions (N, 2) m, and links between them and out of the town."""

    centres: Floats
    links: list[Link] = field(default_factory=list)

    def arms(self, junction: int) -> tuple[Arm, ...]:
        """Return the arms of a junction, counter-clockwise, with headings in [0, 2 pi)."""
        found = []
        for number, link in enumerate(self.links):
            if link.begin == junction:
                found.append((_heading(link.points[0], link.points[1]), number, True))
            if link.end == junction:
                found.append((_heading(link.points[-1], link.points[-2]), number, False))
        return tuple(Arm(*each) for each in sorted(found))


def _heading(start: Floats, end: Floats) -> float:
    """Return the direction from one point (2,) to another, rad, in [0, 2 pi)."""
    return float(exact.arctan2(end[1] - start[1], end[0] - start[0])) % (2 * math.pi)


@dataclass(frozen=True, slots=True)
class Measures:
    """Measures of a sketch.

    Attributes:
        spacing_m: least and largest distance between neighbours in the lattice.
        outer_m: least length of streets that lead out.
        least_rad: least angle between these and others.
        freedom: amount of shear, jitter and bends, in [0, 1].
    """

    spacing_m: tuple[float, float]
    outer_m: float
    least_rad: float
    freedom: float = 1.0


def draw_sketch(rng: np.random.Generator, junctions: int, measures: Measures) -> Sketch:
    """Draw junctions and streets. Arms of a junction may be too close together: the caller must check."""
    cells = _cells(rng, junctions)
    sketch = Sketch(_centres(rng, cells, measures))
    for a, b in _linked(rng, cells):
        sketch.links.append(Link(_bent(rng, sketch.centres[a], sketch.centres[b], measures.freedom), a, b))
    if junctions == 1:
        outer = [_outer(rng, sketch.centres[0], heading, measures.outer_m) for heading in _star(rng)]
        sketch.links += [Link(points, 0, None) for points in outer]
        return sketch
    for number in rng.permutation(junctions).tolist():
        _lead_out(rng, sketch, number, measures)
    return sketch


def _cells(rng: np.random.Generator, count: int) -> list[tuple[int, int]]:
    """Draw connected cells of the lattice, rather compact than long."""
    cells = [(int(rng.integers(_SIDE)), int(rng.integers(_SIDE)))]
    while len(cells) < count:
        weight: dict[tuple[int, int], float] = {}
        for x, y in cells:
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if cell not in cells and 0 <= cell[0] < _SIDE and 0 <= cell[1] < _SIDE:
                    weight[cell] = weight.get(cell, 0.0) * 3 + 1
        shares = np.array(list(weight.values()))
        cells.append(list(weight)[rng.choice(len(weight), p=shares / shares.sum())])
    return cells


def _centres(rng: np.random.Generator, cells: list[tuple[int, int]], measures: Measures) -> Floats:
    places = np.concatenate([np.zeros((1, 2)), rng.uniform(*measures.spacing_m, (_SIDE - 1, 2)).cumsum(axis=0)])
    number = np.array(cells)
    centres = np.column_stack([places[number[:, 0], 0], places[number[:, 1], 1]])
    most_shear = measures.freedom * (_SHEAR if measures.least_rad == LEAST_ANGLE_RAD else _SHEAR / 3)
    shear = rng.uniform(-most_shear, most_shear)
    centres = centres + shear * centres[:, ::-1] * ([1, 0] if rng.random() < 0.5 else [0, 1])
    jitter_m = measures.freedom * _JITTER * measures.spacing_m[0]
    moved: Floats = centres + rng.uniform(-jitter_m, jitter_m, centres.shape)
    return moved


def _linked(rng: np.random.Generator, cells: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return neighbours, some pairs left out where the town stays connected."""
    pairs = [
        (a, b)
        for a, b in combinations(range(len(cells)), 2)
        if abs(cells[a][0] - cells[b][0]) + abs(cells[a][1] - cells[b][1]) == 1
    ]
    for pair in [pairs[k] for k in rng.permutation(len(pairs))]:
        rest = [other for other in pairs if other != pair]
        if rng.random() < _OMITTED and _is_connected(rest, len(cells)):
            pairs = rest
    return pairs


def _is_connected(pairs: list[tuple[int, int]], count: int) -> bool:
    reached = {0}
    for _ in range(count):
        reached |= {end for pair in pairs if reached & set(pair) for end in pair}
    return len(reached) == count


def _bent(rng: np.random.Generator, start: Floats, end: Floats, freedom: float) -> Floats:
    """Return the points of a link: straight, or aside in the middle, or to one side and then to the other."""
    kind, aside = rng.random() / max(freedom, 1e-9), rng.uniform(*_BEND) * rng.choice([-1, 1])
    along = end - start
    left = np.array([-along[1], along[0]])
    if kind < _BENT:
        return np.array([start, start + rng.uniform(0.42, 0.58) * along + aside * left, end])
    if kind < _BENT + _TWICE:
        return np.array([start, start + 0.36 * along + aside / 2 * left, end - 0.36 * along - aside / 2 * left, end])
    return np.array([start, end])


def _star(rng: np.random.Generator) -> list[float]:
    """Draw the arms of a junction that is alone."""
    arms = int(rng.choice([3, 4, 5], p=[0.35, 0.4, 0.25]))
    even, aside = arms == 5 or (arms == 3 and rng.random() < 0.4), 0.06 if arms == 5 else 0.35
    moved = rng.uniform(-aside, aside, arms)
    headings = np.arange(arms) * 2 * np.pi / arms if even else np.array([0.0, np.pi, np.pi / 2, -np.pi / 2])[:arms]
    if not even:
        moved[:2] *= 0.4  # almost straight on
    return [float(heading) for heading in headings + moved]


def _lead_out(rng: np.random.Generator, sketch: Sketch, number: int, measures: Measures) -> None:
    """Add streets that lead out of a junction, so that it has three arms or more, where there is room."""
    wanted = int(rng.choice([3, 4, 5], p=[0.5, 0.42, 0.08]))
    for trial in range(_TRIALS):
        headings = [arm.heading_rad for arm in sketch.arms(number)]
        if len(headings) >= (wanted if trial < _TRIALS // 2 else 3):
            return
        onward = rng.random() < 0.6  # straight on from another arm
        drawn = headings[rng.integers(len(headings))] + np.pi + rng.uniform(-0.1, 0.1)
        heading = drawn if onward else rng.uniform(0, 2 * np.pi)
        apart = [abs(math.remainder(heading - other, 2 * math.pi)) for other in headings]
        if min(apart) < measures.least_rad + 0.05:
            continue
        points = _outer(rng, sketch.centres[number], heading, measures.outer_m)
        if _fits(sketch, points, number):
            sketch.links.append(Link(points, number, None))


def _outer(rng: np.random.Generator, start: Floats, heading: float, least_m: float) -> Floats:
    """Draw a street that leads out, straight or with a bend."""
    length_m = least_m * rng.uniform(1.0, 1.2)
    points = [start, start + length_m * np.array([exact.cos(heading), exact.sin(heading)])]
    if rng.random() < _OUTER_BENT:
        heading += rng.uniform(*_OUTER_TURN_RAD) * rng.choice([-1, 1])
        points.append(points[1] + rng.uniform(26.0, 42.0) * np.array([exact.cos(heading), exact.sin(heading)]))
    else:
        points[1] = points[1] + rng.uniform(0.0, 20.0) * np.array([exact.cos(heading), exact.sin(heading)])
    return np.array(points)


def _fits(sketch: Sketch, points: Floats, number: int) -> bool:
    """Return whether a street that leads out, and the loop at its end, keep their distance from others."""
    ahead = points[-1] - points[-2]
    loop = points[-1] + 20.0 * ahead / exact.hypot(*ahead)
    others = np.concatenate([*(_samples(link.points) for link in sketch.links), sketch.centres])
    apart_m = exact.norm(others - loop, axis=1)
    if apart_m.min() < _LOOP_ROOM_M:
        return False
    centre, own = sketch.centres[number], _samples(points)
    own, others = (each[exact.norm(each - centre, axis=1) > _OWN_M] for each in (own, others))
    if not len(own) or not len(others):
        return True
    return float(exact.norm(own[:, None] - others, axis=2).min()) > _ROOM_M


def _samples(points: Floats) -> Floats:
    share = np.linspace(0.0, 1.0, 13)[:, None]
    legs = [start + share * (end - start) for start, end in pairwise(points)]
    return np.concatenate(legs)
