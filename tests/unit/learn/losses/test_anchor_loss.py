"""The anchor head's loss: its parts by hand, its gradients, and that a head learns one scene by it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips

from coopsim.errors import InvalidValueError
from coopsim.learn.losses.anchor_loss import AnchorLossConfig, Truth, anchor_head_loss, anchor_loss
from coopsim.learn.losses.anchor_targets import AnchorAssignment, anchor_targets, join_anchor_targets
from coopsim.learn.samples.cloud_samples import SampleSettings, collate_detector, detector_loss, detector_samples
from coopsim.nn.detector.anchor_head import AnchorDecoding, AnchorHead, AnchorMaps
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.types import BevGrid, ObjectClass

torch.set_num_threads(1)

GRID = BevGrid((-9.6, 9.6), (-9.6, 9.6), 1.2)
CAR = [0.6, -3.0, 0.78, 3.9, 1.6, 1.56, 0.0]
PARKED = [-4.2, 4.5, 0.8, 4.6, 1.9, 1.5, -1.8]


def maps(batch: int = 1, logit: float = 0.0) -> AnchorMaps:
    """A head that says `logit` everywhere, and boxes like the anchors."""
    shape = (batch, 2, *GRID.shape)
    return AnchorMaps(
        torch.full(shape, logit, requires_grad=True), torch.zeros(batch, 2, 7, *GRID.shape, requires_grad=True),
        torch.zeros(batch, 2, 2, *GRID.shape, requires_grad=True),
    )  # fmt: skip


def test_the_focal_loss_by_hand() -> None:
    """At probability 1/2 an anchor costs (1/2)^2 log 2, times 1/4 if it is an object and 3/4 if not."""
    targets = anchor_targets(np.array([CAR]), GRID)
    parts = anchor_loss(maps(), targets)
    empty = 2 * 16 * 16 - 1
    assert parts["heat"].item() == pytest.approx((0.25 + 0.75 * empty) * 0.25 * math.log(2), rel=1e-5)
    assert parts["box"].item() < 1e-9 and parts["direction"].item() == pytest.approx(0.2 * math.log(2))
    heavier = anchor_loss(maps(), targets, AnchorLossConfig(positive_weight=2))
    assert (heavier["heat"] - parts["heat"]).item() == pytest.approx(0.25 * 0.25 * math.log(2), rel=1e-2)


def test_the_box_loss_by_hand() -> None:
    """2 x (0.5 x error^2 / beta) below beta = 1/9, 2 x (error - beta / 2) above; half a turn of heading is no error."""
    moved = np.array([CAR])
    moved[:, 0] += 0.05 * math.hypot(3.9, 1.6)
    moved[:, 5] *= math.exp(0.5)
    moved[:, 6] += math.pi
    box = anchor_loss(maps(), anchor_targets(moved, GRID))["box"].item()
    assert box == pytest.approx(2 * (0.5 * 0.05**2 * 9 + 0.5 - 1 / 18), rel=1e-4)


def test_ignored_anchors_cost_nothing() -> None:
    targets = anchor_targets(np.array([CAR]), GRID, assignment=AnchorAssignment(between="ignored"))
    said = maps()
    anchor_loss(said, targets)["heat"].backward()
    assert said.logits.grad is not None
    assert ((said.logits.grad == 0) == (targets.role == -1)).all() and (targets.role == -1).any()


def test_samples_count_alike_whatever_they_show() -> None:
    one, none = anchor_targets(np.array([CAR, PARKED]), GRID), anchor_targets(np.zeros((0, 7)), GRID)
    alone = [sum(part.item() for part in anchor_loss(maps(), each).values()) for each in (one, none)]
    both = sum(part.item() for part in anchor_loss(maps(2), join_anchor_targets([one, none])).values())
    assert both == pytest.approx(sum(alone) / 2, rel=1e-5)


def test_no_object_and_sure_maps_stay_finite() -> None:
    for logit in (-100.0, 100.0):
        said = maps(logit=logit)
        for boxes in (np.zeros((0, 7)), np.array([CAR])):
            total = torch.stack(list(anchor_loss(said, anchor_targets(boxes, GRID)).values())).sum()
            total.backward()
            assert torch.isfinite(total)
        assert said.logits.grad is not None and torch.isfinite(said.logits.grad).all()


def test_maps_of_another_grid_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="head's maps"):
        anchor_loss(maps(2), anchor_targets(np.array([CAR]), GRID))


def test_people_are_background() -> None:
    head, features = AnchorHead(4), torch.zeros(1, 4, *GRID.shape)
    boxes, nobody = np.array([CAR]), Truth(np.zeros((0, 7)), np.zeros(0, np.int64), GRID)
    person = anchor_head_loss(head, features, [Truth(boxes, np.array([ObjectClass.PEDESTRIAN]), GRID)])
    assert torch.equal(person["loss"], anchor_head_loss(head, features, [nobody])["loss"])
    bus = anchor_head_loss(head, features, [Truth(boxes, np.array([ObjectClass.BUS]), GRID)])
    assert not torch.equal(bus["loss"], person["loss"])


@pytest.mark.parametrize("direction", [True, False])
def test_a_head_learns_a_scene(direction: bool) -> None:
    """From random features; every parameter has a gradient, and the boxes come out, facing the right way if it can."""
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(1, 32, *GRID.shape, generator=generator)
    head = AnchorHead(32, direction=direction)
    with torch.no_grad():
        head.out.weight.copy_(torch.randn(head.out.weight.shape, generator=generator) * 0.05)
    truth = [Truth(np.array([CAR, PARKED]), np.array([ObjectClass.CAR, ObjectClass.VAN]), GRID)]
    optimizer, first = torch.optim.Adam(head.parameters(), 0.05), 0.0
    for step in range(80):
        optimizer.zero_grad()
        loss = anchor_head_loss(head, features, truth)["loss"]
        loss.backward()
        if not step:
            first = loss.item()
            assert all(each.grad is not None and each.grad.abs().max() > 0 for each in head.parameters())
        optimizer.step()
    assert loss.item() < first / 10
    (found,) = head.decode(features, GRID, AnchorDecoding(least_score=0.5))
    boxes = found.boxes.array[np.argsort(found.boxes.array[:, 1])]
    np.testing.assert_allclose(boxes[:, :6], np.array([CAR, PARKED])[:, :6], atol=0.2)
    turn = boxes[:, 6] - np.array([CAR, PARKED])[:, 6]
    np.testing.assert_allclose(np.sin(turn), 0, atol=0.1)
    assert not direction or (np.cos(turn) > 0).all()


@pytest.mark.parametrize("head", ["anchor", "anchor_direction"])
def test_a_detector_with_anchors_is_trained_as_any_other(head: str) -> None:
    samples = detector_samples(SyntheticClips().clip(0), np.random.default_rng(0), SampleSettings(crop_cells=32))
    sizes = {"pillar_features": 8, "channels": (8, 8, 8), "layers": (0, 0, 0), "features": 8}
    net = DetectorNet(EncoderConfig(head=head, **sizes))  # type: ignore[arg-type]
    parts = detector_loss(net, collate_detector(samples[:2]))
    parts["loss"].backward()
    assert set(parts) == {"loss", "heat", "box"} | ({"direction"} if head == "anchor_direction" else set())
    assert all(each.grad is not None and torch.isfinite(each.grad).all() for each in net.parameters())
