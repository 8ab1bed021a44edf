"""Foliage lets rays through as the law of Beer and Lambert says."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import RayScene, Triangles
from coopsim.support.rng import stream
from coopsim.world.furniture import foliage
from coopsim.world.furniture.foliage import CROWN_PLATES, HEDGE_PLATES_PER_M

ARRANGEMENTS, RAYS, FAR_M = 80, 500, 50.0

Rays = Callable[[np.random.Generator], tuple[Floats, Floats]]
"""Draws points (N, 3) m that rays pass, and their directions (N, 3)."""


@pytest.fixture(autouse=True)
def many_arrangements(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foliage, "VARIANTS", ARRANGEMENTS)


def share_through(make: Callable[[int], Floats], rays: Rays) -> tuple[float, float]:
    """Return the share of rays past the plates of many arrangements, and its standard error over these."""
    shares = []
    for variant in range(ARRANGEMENTS):
        corners = make(variant).reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        zeros: NDArray[np.int64] = np.zeros(len(faces), np.int64)
        scene = RayScene(Triangles(corners, faces, zeros, zeros * 1.0, np.zeros((len(faces), 3), np.uint8)))
        passed, toward = rays(stream(variant, "test rays"))
        shares.append((scene.cast(passed - FAR_M * toward, toward).face < 0).mean())
    return float(np.mean(shares)), float(np.std(shares) / np.sqrt(ARRANGEMENTS))


def level_rays(aside_m: float) -> Rays:
    """Return a draw of level rays of all headings, at one distance from the middle."""

    def draw(draws: np.random.Generator) -> tuple[Floats, Floats]:
        heading, up = draws.uniform(0.0, 2 * np.pi, RAYS), draws.uniform(-0.1, 0.1, RAYS)
        toward = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(RAYS)])
        return np.column_stack([-aside_m * np.sin(heading), aside_m * np.cos(heading), up]), toward

    return draw


@pytest.mark.parametrize("share", [0.0, 0.5, 0.75])
def test_a_crown_lets_rays_through_by_their_path(share: float) -> None:
    size, k = (5.0, 5.0, 6.0), foliage.CROWN_K_PER_M
    body = foliage.ball_of_leaves(size, k, CROWN_PLATES, 0)[1]
    path_m = float(body[0] * np.sqrt(1 - share**2))
    through, error = share_through(
        lambda variant: foliage.ball_of_leaves(size, k, CROWN_PLATES, variant)[0], level_rays(share * body[0] / 2)
    )
    assert error < 0.015
    # Plates reach as far as their radius beyond the body, and are missing as much within: of second order.
    assert through == pytest.approx(np.exp(-k * path_m), abs=3 * error + 0.02)


@pytest.mark.parametrize(("thickness_m", "heading"), [(0.6, np.pi / 2), (0.8, np.pi / 2), (0.8, np.pi / 4), (1.2, 2.0)])
def test_a_hedge_lets_rays_through_by_its_thickness(thickness_m: float, heading: float) -> None:
    k, length = foliage.HEDGE_K_PER_M, 20.0
    count = round(HEDGE_PLATES_PER_M * length)

    def across(draws: np.random.Generator) -> tuple[Floats, Floats]:
        along, up = draws.uniform(-7.0, 7.0, RAYS), draws.uniform(-0.2, 0.2, RAYS)
        toward = np.array([np.cos(heading), np.sin(heading), 0.0])
        return np.column_stack([along, np.zeros(RAYS), up]), np.tile(toward, (RAYS, 1))

    through, error = share_through(
        lambda variant: foliage.block_of_leaves((length, thickness_m, 1.6), k, count, variant)[0], across
    )
    assert error < 0.01
    assert through == pytest.approx(np.exp(-k * thickness_m / np.sin(heading)), abs=3 * error + 0.01)


def test_more_plates_are_smaller_and_let_as_many_rays_through() -> None:
    excess, errors = [], []
    for count in (60, 600):
        through, error = share_through(
            lambda variant, count=count: foliage.ball_of_leaves((5.0, 5.0, 5.0), 0.6, count, variant)[0],
            level_rays(0.0),
        )
        body = foliage.ball_of_leaves((5.0, 5.0, 5.0), 0.6, count, 0)[1]
        excess.append(through - np.exp(-0.6 * body[0]))
        errors.append(error)
    assert excess[0] == pytest.approx(excess[1], abs=3 * sum(errors))


def test_plates_are_seen_from_both_sides_and_arrangements_differ() -> None:
    first, second = (foliage.ball_of_leaves((3.0, 3.0, 3.0), 1.0, 50, variant)[0] for variant in (0, 1))
    assert not np.array_equal(first, second)
    assert np.array_equal(first, foliage.ball_of_leaves((3.0, 3.0, 3.0), 1.0, 50, 0)[0])
    assert not foliage.leaves(first, (0.0, 0.0, 2.0), 0.5, 0).closed
