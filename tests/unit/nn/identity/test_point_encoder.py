"""LGPEnc: unit vectors of any number of points, in any order, each object for itself."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
import torch

from coopsim.errors import CoopsimError
from coopsim.learn.weights import make_network
from coopsim.nn.identity.point_encoder import PointIdentityConfig, PointIdentityNet, join_points

TINY: dict[str, Any] = {"widths": [4, 5, 6, 6, 7], "dim": 3, "points": 16}


def _objects(*counts: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.normal(size=(count, 7)).astype(np.float32) for count in counts]


@pytest.fixture(scope="module")
def net() -> PointIdentityNet:
    net = make_network("point_identity", TINY, 1).eval().requires_grad_(False)
    net.local_scale.normal_()  # as trained ones: neither part is only added
    net.global_scale.normal_()
    return net


def test_it_is_the_equations_written_out(net: PointIdentityNet) -> None:
    (points,) = _objects(6)
    near = net.near(torch.from_numpy(points))
    both = torch.cat([near, net.far(near)], dim=1)
    weight = torch.log1p(net.attention(near).exp())
    attended = torch.zeros(12)
    for j in range(12):
        attended[j] = sum(both[i, j] * weight[i, j] for i in range(6)) / sum(weight[i, j] for i in range(6))
    mixed = net.last(net.local_scale * attended + net.global_scale * both.max(0).values)
    assert net(join_points([points]))[0] == pytest.approx(mixed / mixed.norm(), abs=1e-5)


def test_vectors_have_length_one_and_too_few_points_none(net: PointIdentityNet) -> None:
    found = net(join_points(_objects(0, 4, 5, 16)))
    assert found.shape == (4, 3) and found.norm(dim=1).tolist() == pytest.approx([0, 0, 1, 1])


def test_neither_the_order_of_points_nor_other_objects_matter(net: PointIdentityNet) -> None:
    objects = _objects(9, 3, 0, 16)
    found = net(join_points(objects))
    alone = torch.cat([net(join_points([each])) for each in objects])
    turned = net(join_points([each[::-1].copy() for each in objects]))
    assert torch.allclose(found, alone, atol=1e-6) and torch.allclose(found, turned, atol=1e-6)


def test_the_size_of_the_box_matters_only_where_it_is_asked_for() -> None:
    (points,) = _objects(8)
    longer = points + np.array([0, 0, 0, 0, 1, 0, 0], np.float32)
    for box in (True, False):
        net = make_network("point_identity", TINY | {"box": box}, 1).eval().requires_grad_(False)
        assert torch.allclose(net(join_points([points])), net(join_points([longer])), atol=1e-6) is not box


def test_all_parts_learn() -> None:
    net = make_network("point_identity", TINY)
    (net(join_points(_objects(9, 3, 12))) * torch.arange(3)).sum().backward()
    assert all(each.grad is not None and each.grad.any() for each in net.parameters())


def test_no_objects_are_no_vectors(net: PointIdentityNet) -> None:
    assert net(join_points([])).shape == (0, 3)


def test_sizes_are_the_source_s_or_small_and_come_back_from_their_data() -> None:
    paper = PointIdentityConfig("paper")
    assert (paper.widths[1], paper.widths[4], paper.dim, paper.points) == (64, 1024, 512, 400)  # type: ignore[index]
    net = PointIdentityNet(paper)
    assert net.attention.out_features == 1088 and net.last.out_features == 512
    assert PointIdentityConfig(**asdict(paper)) == paper and PointIdentityConfig().dim == 64


@pytest.mark.parametrize(
    "wrong", [{"size": "huge"}, {"widths": (4, 4)}, {"dim": 0}, {"points": 4}, {"widths": (4,) * 4 + (0,)}]
)
def test_wrong_sizes_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(CoopsimError, match=next(iter(wrong))):
        PointIdentityConfig(**wrong)  # type: ignore[arg-type]
