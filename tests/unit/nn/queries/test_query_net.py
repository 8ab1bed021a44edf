"""The network of queries whole: frames in a row, and any number of senders."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from some_instances import GRID, at, require_close, some_instances, some_map, some_net  # noqa: E402

from coopsim.errors import CoopsimError  # noqa: E402
from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.nn.queries.cooptrack_fusion import ReceivedInstances  # noqa: E402
from coopsim.nn.queries.query_net import QueryConfig, QueryNet, SeenMap, without_duplicates  # noqa: E402

torch.set_num_threads(1)
BOTH = pytest.mark.parametrize("fusion", ["cooptrack", "univ2x"])
HERE = SE3.identity()


def said(seed: int, count: int = 9, delay_s: float = 0.0) -> ReceivedInstances:
    return ReceivedInstances(some_instances(count, seed), HERE, delay_s)


def same_world(seed: int, seen: SeenMap, rows: slice) -> ReceivedInstances:
    """What a sender says of some of the objects that a receiver sees."""
    found = some_instances(len(seen.found), seed)
    near = seen.found.box + 0.1 * torch.randn(seen.found.box.shape, generator=torch.Generator().manual_seed(seed))
    index = torch.arange(len(found))[rows]
    return ReceivedInstances(replace(found, box=near)[index], HERE, 0.0)


@BOTH
def test_a_fresh_network_alone_finds_what_its_detector_found(fusion: str) -> None:
    net, seen = QueryNet(QueryConfig(fusion, features=8, width=16, heads=2)), some_map()
    with torch.no_grad():
        step = net(net.nothing(), 0.0, seen)
    assert torch.allclose(step.instances.box, seen.found.box, atol=1e-5)
    assert torch.allclose(step.instances.score, seen.found.score, atol=1e-4)


@BOTH
def test_a_sender_changes_what_is_found_and_nobody_nothing(fusion: str) -> None:
    net, seen = some_net(fusion), some_map()
    alone = net(net.nothing(), 0.1, seen)
    together = net(net.nothing(), 0.1, seen, [same_world(3, seen, slice(0, 6))], least_affinity=0.0)
    assert not torch.allclose(alone.logits, together.logits[: len(alone.logits)], atol=1e-3)
    nobody = net(net.nothing(), 0.1, seen, [said(3, 0)])
    require_close(alone.instances, nobody.instances, 1e-6)


@BOTH
@pytest.mark.parametrize("delay_s", [0.0, 0.5])
def test_nothing_seen_and_nothing_sent_work(fusion: str, delay_s: float) -> None:
    net, empty = some_net(fusion), some_map(0)
    assert len(net(net.nothing(), 0.1, empty).instances) == 0
    assert len(net(net.nothing(), 0.1, empty, [said(1, 0), said(2, 0)]).instances) == 0
    heard = net(net.nothing(), 0.1, empty, [said(1, 5, delay_s)])
    assert len(heard.instances) == 5 and bool(torch.isfinite(heard.logits).all())


@BOTH
def test_more_instances_than_places_leave_the_surest(fusion: str) -> None:
    net = some_net(fusion, places=10)
    assert len(net(net.nothing(), 0.1, some_map(30)).instances) == 10
    sure = said(5, 20)
    sure = replace(sure, instances=replace(sure.instances, score=torch.full((20,), 0.95)))
    step = net(net.nothing(), 0.1, some_map(30), [sure], least_affinity=2.0)
    assert len(step.instances) == 10
    unsure = some_map(30)
    kept = net(net.nothing(), 0.1, replace(unsure, found=replace(unsure.found, score=torch.full((30,), 0.1))), [sure],
               least_affinity=2.0).instances  # fmt: skip
    assert bool((torch.cdist(kept.box[:, :2], sure.instances.box[:, :2]).amin(1) < 5.0).all())


@BOTH
def test_the_order_of_senders_does_not_matter_for_what_the_receiver_sees(fusion: str) -> None:
    """Beyond rounding; three senders that say something of objects that it sees itself."""
    net, seen = some_net(fusion), some_map(8)
    senders = [same_world(seed, seen, rows) for seed, rows in ((1, slice(0, 5)), (2, slice(3, 8)), (3, slice(0, 8)))]
    given = {"least_affinity": 0.0, "by_rule": True}
    found = [net(net.nothing(), 0.1, seen, [senders[k] for k in order], **given) for order in ((0, 1, 2), (2, 0, 1))]
    require_close(found[0].instances, found[1].instances)


@BOTH
def test_who_is_first_stands_for_a_receiver_that_does_not_see(fusion: str) -> None:
    """Of objects that only senders see the order matters, but only within what the senders differ by."""
    net, seen, empty = some_net(fusion), some_map(6), some_map(0)
    senders = [same_world(seed, seen, slice(0, 6)) for seed in (1, 2)]
    found = [
        net(net.nothing(), 0.1, empty, [senders[k] for k in order], by_rule=True).instances
        for order in ((0, 1), (1, 0))
    ]
    assert len(found[0]) == len(found[1]) == 6
    apart = torch.cdist(found[0].box[:, :2], found[1].box[:, :2]).amin(1)
    assert float(apart.max()) < 1.5


@BOTH
def test_delay_moves_boxes_and_lowers_belief(fusion: str) -> None:
    net, empty = QueryNet(QueryConfig(fusion, features=8, width=16, heads=2)).eval(), some_map(0)
    sent = at([[10, 0]], velocity=torch.tensor([[8.0, 0.0]]))
    with torch.no_grad():
        late = net(net.nothing(), 0.1, empty, [ReceivedInstances(sent, HERE, 0.5)]).instances
    assert late.box[0, 0] == pytest.approx(14.0, abs=1e-4) and float(late.score[0]) < 0.75


def test_instances_of_a_pair_are_one_between_them() -> None:
    net, seen = QueryNet(QueryConfig("cooptrack", features=8, width=16, heads=2)).eval(), some_map(0)
    seen = replace(seen, found=at([[10, 0]]))
    others = ReceivedInstances(at([[11, 0]], velocity=torch.tensor([[2.0, 0.0]]), hits=torch.tensor([2])), HERE, 0.0)
    with torch.no_grad():
        found = net(net.nothing(), 0.1, seen, [others], by_rule=True).instances
    assert len(found) == 1 and float(found.box[0, 0]) == pytest.approx(10.5, abs=1e-4)
    assert float(found.velocity[0, 0]) == pytest.approx(2.0, abs=1e-4)  # the receiver does not know it yet


@pytest.mark.parametrize("without", ["motion", "alignment", "graph"])
def test_a_part_that_is_taken_away_has_no_parameters_or_no_say(without: str) -> None:
    sizes: dict[str, Any] = {"features": 8, "width": 16, "heads": 2, without: False}
    torch.manual_seed(0)
    net, seen = QueryNet(QueryConfig("cooptrack", **sizes)), some_map(6)
    for each in net.parameters():
        torch.nn.init.normal_(each, std=0.3)
    others = replace(same_world(3, seen, slice(0, 6)), delay_s=0.2)
    with torch.no_grad():
        step = net(net.nothing(), 0.1, seen, [others])
        moved = replace(others, instances=replace(others.instances, motion=others.instances.motion + 5.0))
        changed = net(net.nothing(), 0.1, seen, [moved])
    names = {name.split(".")[1] for name, _ in net.named_parameters() if name.startswith("fusion")}
    parts = {"alignment": "align", "graph": "associate"}
    assert names == {"align", "associate", "aggregate"} - {parts.get(without, "")}
    assert len(step.compared) == (without != "graph")
    same = torch.equal(step.instances.motion, changed.instances.motion)
    assert same == (without == "motion")


def test_a_closed_gate_keeps_both() -> None:
    net, seen = some_net(), some_map(6)
    heard = [same_world(1, seen, slice(0, 6))]
    assert len(net(net.nothing(), 0.1, seen, heard, least_affinity=1.5).instances) == 12
    assert len(net(net.nothing(), 0.1, seen, heard, by_rule=True).instances) == 6


def test_turning_the_pose_of_the_world_turns_what_is_found() -> None:
    """Features come from the map, which is alike; all else of the network knows no direction but the boxes' own."""
    seen = some_map(5)
    flat = replace(seen, features=torch.ones_like(seen.features))
    net = QueryNet(QueryConfig("none", features=8, width=16, heads=2)).eval()
    turn = SE3.from_xyz_yaw(np.array([2.0, 1.0, 0.0]), np.pi / 3)
    with torch.no_grad():
        one = net(net.nothing(), 0.1, flat).instances.moved(turn)
        other = net(net.nothing(), 0.1, replace(flat, found=flat.found.moved(turn))).instances
    assert torch.allclose(one.box, other.box, atol=1e-4)


def test_the_past_is_forgotten_after_a_long_time() -> None:
    net, seen = some_net("none"), some_map(5)
    before = net(net.nothing(), 0.0, seen).instances
    assert len(net(before, 0.1, replace(seen, found=seen.found[:0])).instances) == 5
    assert len(net(before, 5.0, replace(seen, found=seen.found[:0])).instances) == 0


@BOTH
def test_gradients_reach_every_part(fusion: str) -> None:
    net = some_net(fusion).requires_grad_(True)
    seen, other = some_map(8), some_map(8, 3)
    before = net(net.nothing(), 0.1, seen).instances.detached()
    before = net(before, 0.1, seen).instances.detached()
    sender = net(net.nothing(), 0.1, other).instances
    near = SE3.from_xyz_yaw(np.array([0.5, 0.3, 0.0]), 0.01)
    heard = [ReceivedInstances(replace(sender, box=before.box[: len(sender)]), near, 0.2)]
    step = net(before, 0.1, seen, heard, by_rule=True)
    total = step.logits.sum() + step.instances.box.sum() + step.instances.velocity.sum()
    (total + sum(each.logits.clamp_min(-50).sum() for each in step.compared)).backward()
    lacking = [name for name, each in net.named_parameters() if each.grad is None or not each.grad.abs().sum()]
    quiet = ("query.bias",)  # a softmax does not mind what is added to all logits
    assert not [name for name in lacking if not any(part in name for part in quiet)]


def test_duplicates_go_and_neighbours_of_other_kinds_stay() -> None:
    found = at([[0, 0], [0.3, 0], [0.2, 0], [20, 0]], score=torch.tensor([0.5, 0.9, 0.4, 0.1]),
               label=torch.tensor([0, 1, 7, 0]))  # fmt: skip
    assert without_duplicates(found).box[:, 0].tolist() == pytest.approx([0.3, 0.2, 20.0])
    assert len(without_duplicates(found[:0])) == 0


@pytest.mark.parametrize(
    ("sizes", "match"),
    [({"fusion": "cooptrak"}, "Did you mean 'cooptrack'"), ({"width": 40}, "width must be divisible by 16"),
     ({"history": -1}, "history must be"), ({"places": 0}, "places must be"),
     ({"fusion": "univ2x", "graph": False}, "parts of the fusion 'cooptrack'")],
)  # fmt: skip
def test_wrong_sizes_are_refused(sizes: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        QueryConfig(**sizes)  # type: ignore[arg-type]
    assert GRID.shape == (48, 48)
