"""Foliage lets rays through as the law of Beer and Lambert says."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import Triangles
from coopsim.support.rng import stream
from coopsim.world.furniture import foliage
from coopsim.world.furniture.plants import CROWN_PLATES, HEDGE_PLATES_PER_M

CROWNS = 60


@pytest.fixture(autouse=True)
def many_arrangements(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foliage, "VARIANTS", CROWNS)


def share_through(
    make: Callable[[int], Floats], starts: Callable[[np.random.Generator], Floats], toward: Floats
) -> tuple[float, float]:
    """Return the share of rays past the plates of many arrangements, and its standard error over these."""
    shares = []
    for variant in range(CROWNS):
        corners = make(variant).reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        zeros: NDArray[np.int64] = np.zeros(len(faces), np.int64)
        scene = RayScene(Triangles(corners, faces, zeros, zeros * 1.0, np.zeros((len(faces), 3), np.uint8)))
        origin = starts(stream(variant, "test rays"))
        shares.append((scene.cast(origin, np.tile(toward, (len(origin), 1))).face < 0).mean())
    return float(np.mean(shares)), float(np.std(shares) / np.sqrt(CROWNS))


def around_line(offset: Floats, toward: Floats, width_m: float) -> Callable[[np.random.Generator], Floats]:
    """Return a draw of starts 50 m before a point, a little aside of it."""

    def starts(draws: np.random.Generator) -> Floats:
        aside = draws.uniform(-width_m, width_m, (400, 3))
        aside -= (aside @ toward)[:, None] * toward
        found: Floats = offset - 50.0 * toward + aside
        return found

    return starts


@pytest.mark.parametrize("share", [0.0, 0.5, 0.75])
@pytest.mark.parametrize("heading", [0.3, 1.9])
def test_a_crown_lets_rays_through_by_their_path(share: float, heading: float) -> None:
    toward = np.array([np.cos(heading), np.sin(heading), 0.0])
    left = np.array([-toward[1], toward[0], 0.0])
    size, k = (5.0, 5.0, 6.0), foliage.CROWN_K_PER_M
    body = foliage.ball_of_leaves(size, k, CROWN_PLATES, 0)[1]
    path_m = float(body[0] * np.sqrt(1 - share**2))
    through, error = share_through(
        lambda variant: foliage.ball_of_leaves(size, k, CROWN_PLATES, variant)[0],
        around_line(share * body[0] / 2 * left, toward, 0.1),
        toward,
    )
    # At the rim, plates that reach beyond the body smooth the path: an error of second order in their size.
    assert through == pytest.approx(np.exp(-k * path_m), abs=3 * error + (0.02 if share < 0.7 else 0.06))


@pytest.mark.parametrize(("thickness_m", "heading"), [(0.6, np.pi / 2), (0.8, np.pi / 2), (0.8, np.pi / 4), (1.2, 2.0)])
def test_a_hedge_lets_rays_through_by_its_thickness(thickness_m: float, heading: float) -> None:
    toward = np.array([np.cos(heading), np.sin(heading), 0.0])
    k, length = foliage.HEDGE_K_PER_M, 12.0
    count = round(HEDGE_PLATES_PER_M * length)
    through, error = share_through(
        lambda variant: foliage.block_of_leaves((length, thickness_m, 1.6), k, count, variant)[0],
        around_line(np.zeros(3), toward, 0.15),
        toward,
    )
    assert through == pytest.approx(np.exp(-k * thickness_m / np.sin(heading)), abs=3 * error + 0.02)


def test_more_plates_are_smaller_and_let_as_many_rays_through() -> None:
    toward = np.array([1.0, 0.0, 0.0])
    few, many = (
        share_through(
            lambda variant, count=count: foliage.ball_of_leaves((5.0, 5.0, 5.0), 0.6, count, variant)[0],
            around_line(np.zeros(3), toward, 0.3),
            toward,
        )
        for count in (60, 600)
    )
    body = [foliage.ball_of_leaves((5.0, 5.0, 5.0), 0.6, count, 0)[1][0] for count in (60, 600)]
    assert few[0] - np.exp(-0.6 * body[0]) == pytest.approx(
        many[0] - np.exp(-0.6 * body[1]), abs=3 * few[1] + 3 * many[1]
    )


def test_plates_are_seen_from_both_sides_and_arrangements_differ() -> None:
    first, second = (foliage.ball_of_leaves((3.0, 3.0, 3.0), 1.0, 50, variant)[0] for variant in (0, 1))
    assert not np.array_equal(first, second)
    assert np.array_equal(first, foliage.ball_of_leaves((3.0, 3.0, 3.0), 1.0, 50, 0)[0])
    assert not foliage.leaves(first, (0.0, 0.0, 2.0), 0.5, 0).closed
