"""Temporal prior enhancement: its equation, a first frame, and what motion between frames is to it."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.nn.integrated.encoder import (  # noqa: E402
    IntegratedEncoder,
    PriorEnhancement,
    PriorMap,
    cell_places,
)
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
WIDTH = 8
GRID = BevGrid((-12.0, 12.0), (-6.0, 6.0), 1.2)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def enhancement() -> PriorEnhancement:
    torch.manual_seed(0)
    made = PriorEnhancement(WIDTH)
    torch.nn.init.normal_(made.out.weight)
    return made.requires_grad_(False)


def encoder() -> IntegratedEncoder:
    torch.manual_seed(0)
    made = IntegratedEncoder(6, WIDTH, 1, 2, 2)
    for layer in (made.enhance.out, made.added):
        torch.nn.init.normal_(layer.weight)
    return made.requires_grad_(False)


def test_it_is_its_equation() -> None:
    net, tokens, place = enhancement(), draw(5, WIDTH), 20 * draw(5, 2, seed=1)
    before = PriorMap(draw(3, WIDTH, seed=2), 20 * draw(3, 2, seed=3))
    query = net.query(net.norm(tokens) + net._code(place)) + net.age(torch.tensor([0.4]))
    key = net.key(net.norm(before.tokens) + net._code(before.place_m))
    value, expected = net.value(net.norm(before.tokens)), []
    for q in range(5):
        share = torch.tensor([float(torch.dot(query[q], key[k])) / WIDTH**0.5 for k in range(3)]).exp()
        mean = sum((share[k] / share.sum() * value[k] for k in range(3)), torch.zeros(WIDTH))
        expected.append(tokens[q] + net.out(net.then(mean)))
    assert torch.allclose(net(tokens, place, before, 0.4), torch.stack(expected), atol=1e-5)


def test_a_fresh_one_changes_nothing() -> None:
    tokens = draw(5, WIDTH)
    before = PriorMap(draw(3, WIDTH, seed=2), draw(3, 2, seed=3))
    with torch.no_grad():
        assert torch.equal(PriorEnhancement(WIDTH)(tokens, draw(5, 2), before, 0.1), tokens)


def test_without_a_frame_before_the_map_is_its_own() -> None:
    net, fused = encoder(), draw(6, 10, 20).abs()
    first = net(fused, GRID, None, 0.0)
    again = net(fused, GRID, first.prior, 0.0)
    later = net(fused, GRID, first.prior, 0.5)
    other = net(fused, GRID, net(draw(6, 10, 20, seed=5).abs(), GRID, None, 0.0).prior, 0.0)
    assert torch.equal(first.features, again.features)
    for changed in (later, other):
        assert not torch.allclose(first.features, changed.features, atol=1e-3)


def test_a_kept_map_has_the_largest_features_of_blocks_at_their_middles() -> None:
    cells = GRID.coarser(2)
    features = draw(WIDTH, *cells.shape)
    kept = PriorMap.of(features, cells)
    assert kept.tokens.shape == (2 * 3, WIDTH)  # of 5 x 10 cells, blocks of 4 x 4 and what is left at the edges
    assert torch.equal(kept.tokens[0], features[:, :4, :4].amax((1, 2)))
    assert torch.equal(kept.tokens[5], features[:, 4:, 8:].amax((1, 2)))
    places = cell_places(cells, features).view(*cells.shape, 2)
    assert torch.allclose(kept.place_m[5], places[4:, 8:].mean((0, 1)))


def test_places_move_with_the_agent() -> None:
    kept = PriorMap.of(draw(WIDTH, 4, 4), BevGrid((100.3, 104.3), (0.0, 4.0), 1.0))
    with torch.autocast("cpu", torch.bfloat16):
        moved = kept.moved(SE3.from_xyz_yaw(np.array([10.0, 0.0, 3.0]), np.pi / 2))
    assert torch.allclose(moved.place_m, torch.tensor([[8.0, 102.3]]), atol=1e-5)
    assert torch.equal(moved.tokens, kept.tokens)
