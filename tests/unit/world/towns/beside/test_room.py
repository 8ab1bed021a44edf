import numpy as np
import pytest
from shapely import LineString, Polygon

from coopsim.world.places.layout import rectangle
from coopsim.world.towns.beside.room import Room


def turned_rectangle(rng):
    angle = rng.uniform(0, np.pi)
    corners = rectangle((0, rng.uniform(1, 8)), (0, rng.uniform(1, 8)))
    return corners @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]] + rng.uniform(-8, 8, 2)


def test_taken_ground_is_what_overlaps():
    rng, room = np.random.default_rng(0), Room()
    taken = [turned_rectangle(rng) for _ in range(4)]
    for outline in taken:
        room.take(outline)
    for _ in range(300):
        outline = turned_rectangle(rng)
        overlaps = any(Polygon(outline).intersection(Polygon(other)).area > 1e-9 for other in taken)
        assert room.is_free(outline) != overlaps


def test_free_ground_is_as_far_away_as_asked_for():
    rng, room = np.random.default_rng(1), Room()
    line = np.array([[-5.0, -3.0], [4.0, 2.0]])
    room.take(line, 1.5)
    free = [outline for outline in (turned_rectangle(rng) for _ in range(300)) if room.is_free(outline, 0.5)]
    assert 0 < len(free) < 300
    assert min(Polygon(outline).distance(LineString(line)) for outline in free) >= 2.0 - 1e-9


@pytest.mark.parametrize(("at", "free"), [(1.9, False), (2.1, True)])
def test_gap_along_a_side(at, free):
    room = Room()
    room.take(rectangle((0, 1), (0, 1)))
    assert room.is_free(rectangle((at, 3), (0, 1)), 1.0) == free


def test_nothing_is_taken_where_one_part_does_not_fit():
    room = Room()
    room.take(rectangle((0, 1), (0, 1)))
    assert not room.try_take([rectangle((5, 6), (0, 1)), rectangle((0, 2), (0, 1))])
    assert room.try_take([rectangle((5, 6), (0, 1))])
    assert not room.is_free(rectangle((5, 6), (0, 1)))


def test_room_grows():
    room = Room()
    for k in range(600):
        room.take(rectangle((2 * k, 2 * k + 1), (0, 1)))
    assert not room.is_free(rectangle((1000.2, 1000.4), (0, 1)))
    assert room.is_free(rectangle((1001.2, 1001.4), (0, 1)))
