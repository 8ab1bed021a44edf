"""Losses of the street head: fronts as a class that turns with the box, and velocities at their full size."""

from __future__ import annotations

import numpy as np
import torch

from coopsim.learn.losses.head_losses import head_loss, sum_of
from coopsim.learn.losses.street_losses import front_class_loss, velocity_loss
from coopsim.learn.samples.targets import Targets, make_targets
from coopsim.nn.detector.decode import cell_centers
from coopsim.nn.detector.detector_net import HEADING, VELOCITY, DetectorNet, decode_boxes, front_logits
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.types import BevGrid

torch.set_num_threads(1)
GRID = BevGrid((-24.0, 24.0), (-24.0, 24.0), 1.2)
YAWS = np.array([0.3, 1.571, -1.57, 3.14, -2.5])


def targets(yaw: np.ndarray = YAWS, speed: float = 0.0, **more: bool) -> Targets:
    """Return the targets of cars in a row."""
    count = len(yaw)
    boxes = np.column_stack(
        [np.linspace(-20, 20, count), np.zeros(count), np.tile([0.8, 4.6, 1.9, 1.6], (count, 1)), yaw]
    )
    velocity = speed * np.column_stack([np.cos(yaw), np.sin(yaw)])
    return make_targets(boxes, velocity, np.zeros(count, np.int64), GRID, **more)


def code_of(true: Targets) -> torch.Tensor:
    code = torch.zeros(len(true.cell), 19)
    code[:, :12] = true.code
    return code


def test_the_class_of_a_front_turns_with_the_box() -> None:
    true, reversed_ = targets(), targets(YAWS + np.pi)
    code = code_of(true)
    code[:, HEADING] *= 5
    torch.testing.assert_close(front_logits(code, true.yaw), -front_logits(code, reversed_.yaw), atol=1e-5, rtol=1e-5)
    assert front_class_loss(code, true) < 0.01
    assert front_class_loss(code, reversed_) > 4
    undecided = code.clone()
    undecided[:, HEADING] = 0
    np.testing.assert_allclose(float(front_class_loss(undecided, true)), np.log(2), atol=1e-5)


def test_boxes_are_decoded_with_the_front_that_the_class_says() -> None:
    true = targets()
    code = code_of(true)
    ahead, _ = decode_boxes(code, true.label, cell_centers(true.cell, GRID), GRID.cell_m)
    code[:, HEADING] *= -0.01
    behind, _ = decode_boxes(code, true.label, cell_centers(true.cell, GRID), GRID.cell_m)
    assert (torch.cos(ahead[:, 6] - true.yaw) > 0.999).all()
    assert (torch.cos(behind[:, 6] - true.yaw) < -0.999).all()
    torch.testing.assert_close(ahead[:, :6], behind[:, :6])


def test_velocities_of_what_moves_are_not_diluted_by_what_stands() -> None:
    yaw = np.zeros(1)
    moving, few, many = targets(yaw, 10.0), targets(np.zeros(2)), targets(np.zeros(9))
    shows_none = targets(yaw, 10.0, moves=False)
    silent = code_of(moving)
    silent[:, VELOCITY] = 0
    tenth = code_of(moving)
    tenth[:, VELOCITY] *= 0.1
    assert velocity_loss(code_of(moving), moving) == 0
    assert velocity_loss(tenth, moving) > 0.8 * velocity_loss(silent, moving) > 0.5
    assert velocity_loss(silent, shows_none) == 0
    for others in (few, many):
        joined = Targets(
            moving.heat, *(torch.cat([getattr(moving, name), getattr(others, name)]) for name in
                           ("cell", "code", "weight", "label", "yaw", "moves")),
            moving.ignored, 0, moving.cell_m,
        )  # fmt: skip
        both = velocity_loss(torch.cat([silent, code_of(others)]), joined)
        torch.testing.assert_close(both, velocity_loss(silent, moving))


def drive() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (P, 5) of two sweeps 0.1 s apart, and boxes and velocities of four cars, of which two drive."""
    rng = np.random.default_rng(0)
    places = np.array([[-12.0, -12.0], [-12.0, 10.0], [12.0, -10.0], [10.0, 12.0]])
    boxes = np.column_stack([places, np.tile([0.8, 4.6, 1.9, 1.6], (4, 1)), [0.2, -1.4, 2.4, 0.9]])
    velocity = np.array([14.0, 6.0, 0.0, 0.0])[:, None] * np.column_stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])])
    clouds = []
    for age_s in (0.0, 0.1):
        unit = rng.uniform(-0.5, 0.5, (4, 60, 3))
        unit[:, :30, 0], unit[:, 30:, 1] = np.sign(unit[:, :30, 0]) / 2, np.sign(unit[:, 30:, 1]) / 2
        at = unit * boxes[:, None, 3:6]
        cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
        xy = np.stack([cos * at[..., 0] - sin * at[..., 1], sin * at[..., 0] + cos * at[..., 1]], axis=-1)
        xy += boxes[:, None, :2] - age_s * velocity[:, None]
        clouds.append(np.column_stack([xy.reshape(-1, 2), at[..., 2].ravel() + 0.8, np.full((240, 2), [0.5, age_s])]))
    return np.concatenate(clouds).astype(np.float32), boxes, velocity


def test_a_batch_learned_by_heart_has_velocities_of_full_size() -> None:
    points, boxes, velocity = drive()
    config = EncoderConfig(0.6, 16, (16, 16, 16), (1, 1, 1), 16, sweeps=2, head="street", layout="sparse", apart=True)
    batch = collate([pillarize(points, BevGrid(GRID.x_m, GRID.y_m, 0.6), config.pillars)])
    true = make_targets(boxes, velocity, np.zeros(4, np.int64), GRID)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        net = DetectorNet(config)
    adam = torch.optim.AdamW(net.parameters(), lr=0.02)
    for _ in range(40):
        parts = head_loss(net.head, net.encoder(batch), true)
        adam.zero_grad()
        sum_of(parts, {"velocity": 1.0}).backward()
        adam.step()
    with torch.no_grad():
        shared, _ = net.head.heat(net.encoder(batch))
        rows = shared.permute(0, 2, 3, 1).flatten(0, 2)[true.cell]
        _, found = decode_boxes(net.head.codes(rows), true.label, cell_centers(true.cell, GRID), GRID.cell_m)
    truth = true.code[:, VELOCITY] * 10
    moving = truth.norm(dim=1) > 1
    error = (found - truth).norm(dim=1)
    assert (error[moving] / truth.norm(dim=1)[moving]).median() < 0.15
    assert error[~moving].median() < 0.5
