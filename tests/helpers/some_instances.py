"""Instances at random places, and networks of queries with weights that do something."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from coopsim.nn.queries.instances import Instances
from coopsim.nn.queries.query_net import QueryConfig, QueryNet, SeenMap
from coopsim.types import BevGrid

WIDTH, FRAMES, FEATURES = 16, 4, 8
GRID = BevGrid((-48, 48), (-48, 48), 2.0)


def some_instances(count: int, seed: int = 0, **changes: Any) -> Instances:
    """Cars with features, history of the last two frames, and velocities."""
    draw = torch.Generator().manual_seed(seed)

    def rand(*shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=draw)

    box = torch.cat(
        [80 * rand(count, 2) - 40, rand(count, 1), torch.tensor([4.5, 1.9, 1.6]).expand(count, 3), 6 * rand(count, 1)],
        dim=1,
    )
    age_s = torch.tensor([0.1, 0.2, torch.inf, torch.inf]).expand(count, FRAMES)
    known = Instances.seen(box, 0.1 + 0.8 * rand(count), torch.zeros(count, dtype=torch.int64), WIDTH, FRAMES)
    past = rand(2, count, FRAMES, WIDTH) * torch.isfinite(age_s)[..., None]
    return replace(
        known, velocity=4 * rand(count, 2) - 2, semantic=rand(count, WIDTH), motion=rand(count, WIDTH),
        past_semantic=past[0], past_motion=past[1], past_age_s=age_s, hits=known.hits + 1, **changes,
    )  # fmt: skip


def at(places: Any, **changes: Any) -> Instances:
    """Cars that stand at places (K, 2), facing along x, seen once."""
    xy = torch.tensor(places, dtype=torch.float32).reshape(-1, 2)
    rest = torch.tensor([0.8, 4.5, 1.9, 1.6, 0.0]).expand(len(xy), 5)
    label = torch.zeros(len(xy), dtype=torch.int64)
    seen = Instances.seen(torch.cat([xy, rest], dim=1), torch.full((len(xy),), 0.8), label, WIDTH, FRAMES)
    return replace(seen, **changes)


def some_map(count: int = 12, seed: int = 0) -> SeenMap:
    """A random map with some objects on it."""
    found = some_instances(count, seed)
    features = torch.rand(FEATURES, *GRID.shape, generator=torch.Generator().manual_seed(seed + 50))
    seen = Instances.seen(found.box, found.score, found.label, WIDTH, FRAMES)
    return SeenMap(features, GRID, seen)


def some_net(fusion: str = "cooptrack", **sizes: Any) -> QueryNet:
    """A tiny network of which no part is without effect."""
    given: dict[str, Any] = {"features": FEATURES, "width": WIDTH, "history": FRAMES, "heads": 2, "places": 32}
    net = QueryNet(QueryConfig(fusion, **(given | sizes)))
    for number, weights in enumerate(net.parameters()):
        draw = torch.Generator().manual_seed(number)
        with torch.no_grad():
            weights.copy_(0.2 * torch.randn(weights.shape, generator=draw) + (weights.ndim == 1))
    return net.eval().requires_grad_(False)


def require_close(one: Instances, other: Instances, atol: float = 1e-4) -> None:
    """Require two sets of instances to be alike, in any order."""
    assert len(one) == len(other)
    sets = [each[torch.argsort(each.box[:, 0])] for each in (one, other)]
    for name in ("box", "velocity", "score", "semantic", "motion"):
        a, b = (getattr(each, name) for each in sets)
        assert torch.allclose(a, b, atol=atol), name
