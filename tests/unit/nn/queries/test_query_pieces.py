"""The pieces of the network of queries, each by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from some_instances import FRAMES, WIDTH, at, some_instances, some_map, some_net  # noqa: E402

from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.nn.queries.attention import AmongInstances, InstanceHistory  # noqa: E402
from coopsim.nn.queries.cooptrack_fusion import BLOCK, LatentAlignment, aligned_boxes  # noqa: E402
from coopsim.nn.queries.decoder import MotionFeatures, corners  # noqa: E402
from coopsim.nn.queries.instance_fusion import (  # noqa: E402
    IMPOSSIBLE,
    GraphAssociation,
    pairs_by_gate,
    pairs_by_rule,
    sure_pairs,
)

torch.set_num_threads(1)
HERE = SE3.identity()


def started(module: torch.nn.Module, seed: int = 0) -> torch.nn.Module:
    for number, weights in enumerate(module.parameters()):
        draw = torch.Generator().manual_seed(seed + number)
        with torch.no_grad():
            weights.copy_(0.3 * torch.randn(weights.shape, generator=draw) + (weights.ndim == 1))
    return module.requires_grad_(False)


def test_corners_are_those_of_the_box() -> None:
    box = torch.tensor([[5.0, 6.0, 1.0, 4.0, 2.0, 1.0, np.pi / 2]])
    assert torch.allclose(corners(box).abs().amax(1), torch.tensor([[1.0, 2.0, 0.5]]), atol=1e-5)
    assert torch.allclose(corners(box).sum(1), torch.zeros(1, 3), atol=1e-5)


def test_of_corners_the_largest_features_count() -> None:
    net, known = started(MotionFeatures(WIDTH)), some_instances(5)
    each = torch.stack([net.corners(corner) for corner in corners(known.box).unbind(1)])
    turned = torch.column_stack([known.box[:, 6].cos(), known.box[:, 6].sin(), known.velocity / 10.0])
    expected = net.join(torch.cat([each.max(0).values, net.speed(turned)], dim=1))
    assert torch.allclose(net(known.box, known.velocity), expected, atol=1e-5)


def test_motion_does_not_know_where_the_object_is() -> None:
    net, known = started(MotionFeatures(WIDTH)), some_instances(5)
    elsewhere = known.box + torch.tensor([10.0, -3.0, 0.5, 0, 0, 0, 0])
    assert torch.equal(net(known.box, known.velocity), net(elsewhere, known.velocity))
    assert not torch.allclose(net(known.box, known.velocity), net(known.box, known.velocity + 1))


def test_the_order_of_instances_does_not_matter_among_them() -> None:
    net, known, order = started(AmongInstances(WIDTH, 2)), some_instances(6), torch.tensor([3, 1, 5, 0, 4, 2])
    one = net(known.semantic, known.box[:, :2])
    assert torch.allclose(net(known.semantic[order], known.box[order, :2]), one[order], atol=1e-5)
    assert len(net(known.semantic[:0], known.box[:0, :2])) == 0


def test_attention_begins_without_effect() -> None:
    net, known = AmongInstances(WIDTH, 2), some_instances(6)
    assert torch.equal(net(known.semantic, known.box[:, :2]), known.semantic)


def history(**changes: torch.Tensor) -> torch.Tensor:
    net, known = started(InstanceHistory(WIDTH, 2, 2)), some_instances(4)
    given = {"past": known.past_semantic, "age_s": known.past_age_s} | changes
    found: torch.Tensor = net(known.semantic, given["past"], given["age_s"], known.box[:, :2])
    return found


def test_frames_that_there_were_not_are_masked() -> None:
    known = some_instances(4)
    wild = torch.where(torch.isfinite(known.past_age_s)[..., None], known.past_semantic, 99.0)
    assert torch.equal(history(), history(past=wild))
    assert not torch.allclose(history(), history(past=known.past_semantic + 1))


def test_how_old_the_past_is_matters() -> None:
    assert not torch.allclose(history(), history(age_s=some_instances(4).past_age_s + 0.4))


def test_who_has_no_past_is_left_as_it_is_and_finite() -> None:
    net, known = started(InstanceHistory(WIDTH, 2, 2)), at([[3, 4]], semantic=torch.rand(1, WIDTH))
    found = net(known.semantic, known.past_semantic, known.past_age_s, known.box[:, :2])
    alone = known.semantic
    for among in net.among:
        alone = among(alone, known.box[:, :2])
    assert torch.equal(found, alone) and bool(torch.isfinite(found).all())


def test_boxes_are_aligned_by_motion_and_by_delay() -> None:
    sent = at([[10.0, 0.0]], velocity=torch.tensor([[5.0, 0.0]]))
    placed = aligned_boxes(sent, SE3.from_xyz_yaw(np.array([1.0, 2.0, 0.0]), np.pi / 2), 0.4)
    assert torch.allclose(placed.box[0, :2], torch.tensor([1.0, 14.0]), atol=1e-5)
    assert torch.allclose(placed.velocity[0], torch.tensor([0.0, 5.0]), atol=1e-5)


def test_latent_alignment_begins_as_what_was_sent() -> None:
    net, sent = LatentAlignment(WIDTH), some_instances(4)
    turn = SE3.from_xyz_yaw(np.array([9.0, 1.0, 0.0]), 1.0)
    found = net(sent, turn, 0.3)
    assert torch.equal(found.semantic, sent.semantic) and torch.equal(found.motion, sent.motion)
    assert torch.equal(net.rotation(torch.eye(3))[0], torch.eye(BLOCK))


def test_latent_alignment_equals_its_equation_and_knows_the_delay() -> None:
    net, sent = started(LatentAlignment(2 * BLOCK)), some_instances(4)
    sent = replace(sent, semantic=torch.rand(4, 2 * BLOCK), motion=torch.rand(4, 2 * BLOCK))
    turn = SE3.from_xyz_yaw(np.array([9.0, 1.0, 0.0]), 1.0)
    found = net(sent, turn, 0.0)
    rotation = torch.tensor(turn.rotation, dtype=torch.float32)
    whole = torch.block_diag(*net.rotation(rotation))
    shift = net.shift(torch.tensor(turn.translation, dtype=torch.float32) / 50.0)
    for part in ("semantic", "motion"):
        given = getattr(sent, part)
        expected = given + net.out[part](net.into[part](given) @ whole.T + shift + given)
        assert torch.allclose(getattr(found, part), expected, atol=1e-4)
    for other in (net(sent, turn, 0.3), net(sent, HERE, 0.0)):
        assert not torch.allclose(other.semantic, found.semantic, atol=1e-3)
    assert len(net(sent[torch.zeros(0, dtype=torch.int64)], turn, 0.1)) == 0


def test_the_graph_compares_pairs_within_reach_alone() -> None:
    net = started(GraphAssociation(WIDTH))
    own, others = some_instances(5, 1), some_instances(3, 2)
    own = replace(own, box=torch.cat([torch.tensor([[0.0, 0], [3, 0], [6, 0], [30, 0], [60, 0]]), own.box[:, 2:]], 1))
    others = replace(others, box=torch.cat([torch.tensor([[0.0, 1], [31, 0], [-10, 0]]), others.box[:, 2:]], 1))
    others.box[2, 2] = own.box[0, 2]  # exactly as far as the reach
    logits = net(own, others)
    near = (own.box[:, None, :3] - others.box[:, :3]).norm(dim=-1) <= 10.0
    assert near.sum() == 5 and bool((logits[~near] == IMPOSSIBLE).all()) and bool((logits[near] > IMPOSSIBLE).all())
    query = net.query(net.own(torch.cat([own.semantic, own.motion], 1)))[1]
    key = net.key(net.others(torch.cat([others.semantic, others.motion], 1)))[0]
    edge = net.mix(net.edge((own.box[1, :3] - others.box[0, :3]) / 5.0))
    learned = float(net.judge(query @ key / WIDTH**0.5 + edge))
    assert float(logits[1, 0]) == pytest.approx(3.5 - 10.0**0.5 + learned, abs=1e-4)


def test_the_graph_starts_as_the_rule() -> None:
    own, others = some_instances(6, 1), some_instances(6, 2)
    others = replace(others, box=own.box + torch.linspace(-4.0, 4.0, 6)[:, None] * torch.eye(7)[0])
    found = sure_pairs(GraphAssociation(WIDTH)(own, others), 0.5)
    assert all(np.array_equal(*each) for each in zip(found, pairs_by_rule(own, others), strict=True))
    assert 0 < len(found[0]) < 6


def test_the_threshold_closes() -> None:
    logits = torch.tensor([[2.0, -1.0], [-1.0, 0.4], [3.0, -9.0]])
    assert [each.tolist() for each in sure_pairs(logits, 0.5)] == [[1, 2], [1, 0]]
    assert [each.tolist() for each in sure_pairs(logits, 0.9)] == [[2], [0]]
    for none in (sure_pairs(logits, 1.01), sure_pairs(logits[:0], 0.5), sure_pairs(logits[:, :0], 0.5)):
        assert len(none[0]) == len(none[1]) == 0


def test_the_rule_takes_the_nearest_within_reach() -> None:
    rows, columns = pairs_by_rule(at([[0, 0], [2, 0], [50, 0]]), at([[1.9, 0], [0.4, 0], [53.6, 0]]))
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [1, 0])


def test_the_gate_is_the_size_of_the_own_box_along_its_axes() -> None:
    own = at([[0, 0], [0, 20], [0, 40], [0, 60]], score=torch.tensor([0.8, 0.8, 0.8, 0.01]))
    others = at([[4.4, 0], [0, 22], [4.6, 40], [0, 60]])
    assert [each.tolist() for each in pairs_by_gate(own, others, 0.05)] == [[0], [0]]
    turn = SE3.from_xyz_yaw(np.zeros(3), np.pi / 2)
    assert [each.tolist() for each in pairs_by_gate(own.moved(turn), others.moved(turn), 0.05)] == [[0], [0]]
    assert len(pairs_by_gate(own[:0], others, 0.05)[0]) == 0


def test_heads_begin_with_what_the_detector_found() -> None:
    from coopsim.nn.queries.decoder import InstanceHeads

    heads, found = InstanceHeads(WIDTH), some_instances(6)
    logits = heads.logits(found, found.semantic)
    assert torch.allclose(logits.sigmoid().max(1).values, found.score, atol=1e-5)
    assert torch.equal(logits.argmax(1), found.label)
    box, velocity = heads.boxes(found, found.semantic, found.motion)
    assert torch.allclose(box, found.box, atol=1e-6) and torch.equal(velocity, found.velocity)


def test_decoding_sees_the_map_only_at_the_object() -> None:
    net, seen = some_net("none"), some_map(1)
    near = net(net.nothing(), 0.0, seen).logits
    row, column = (int((float(seen.found.box[0, axis]) + 48) // 2) for axis in (1, 0))
    far = seen.features.clone()
    far[:, (row + 24) % 48, (column + 24) % 48] += 5
    there = seen.features.clone()
    there[:, row, column] += 5
    assert torch.equal(net(net.nothing(), 0.0, replace(seen, features=far)).logits, near)
    assert not torch.allclose(net(net.nothing(), 0.0, replace(seen, features=there)).logits, near)
    assert near.new_tensor(net(net.nothing(), 0.0, seen).instances.past_age_s.shape[1]) == FRAMES
