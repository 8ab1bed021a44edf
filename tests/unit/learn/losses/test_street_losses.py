"""Losses of the street head: motions at their full size, whatever the heading of a box."""

from __future__ import annotations

import numpy as np
import torch

from coopsim.learn.losses.head_losses import head_loss, sum_of
from coopsim.learn.losses.judge_losses import found_boxes
from coopsim.learn.losses.street_losses import motion_loss
from coopsim.learn.samples.targets import make_targets
from coopsim.nn.detector.box_judge import over_ground
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.types import BevGrid

torch.set_num_threads(1)
GRID = BevGrid((-24.0, 24.0), (-24.0, 24.0), 1.2)


def test_motions_are_seen_from_a_box_and_from_its_other_end() -> None:
    velocity, yaw = np.array([[3.0, 4.0], [0.0, -2.0]]), np.array([0.3, -2.0])

    def seen_from(yaw: np.ndarray) -> np.ndarray:
        return over_ground(torch.from_numpy(velocity), -torch.from_numpy(yaw)).numpy()

    motion = seen_from(yaw)
    np.testing.assert_allclose(seen_from(yaw + np.pi), -motion)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
    np.testing.assert_allclose(motion[:, 0], (velocity * ahead).sum(axis=1))
    np.testing.assert_allclose(over_ground(torch.from_numpy(motion), torch.from_numpy(yaw)), velocity)


def test_motions_of_what_moves_are_not_diluted_by_what_stands() -> None:
    moving, silent, one = torch.tensor([[10.0, 0.0]]), torch.zeros(1, 2), torch.ones(1)
    assert motion_loss(moving, moving, one) == 0
    alone = motion_loss(silent, moving, one)
    assert motion_loss(0.1 * moving, moving, one) > 0.8 * alone > 0.5
    assert motion_loss(silent, moving, 0 * one) == 0
    for others in (2, 9):
        stand = torch.zeros(others, 2)
        both = motion_loss(torch.zeros(1 + others, 2), torch.cat([moving, stand]), torch.ones(1 + others))
        torch.testing.assert_close(both, alone)


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
    for _ in range(80):
        parts = head_loss(net.head, net.encoder(batch), true)
        adam.zero_grad()
        sum_of(parts, {"velocity": 1.0}).backward()
        adam.step()
    found = decode(net.head, net.encoder(batch), GRID, moving=[True])[0]
    away = np.linalg.norm(found.boxes.center[:, None, :2] - boxes[:, :2], axis=2)
    row = away.argmin(axis=0)
    assert away.min(axis=0).max() < 1.0
    assert found.velocity is not None
    error = np.linalg.norm(found.velocity[row] - velocity, axis=1)
    assert np.median(error[:2] / [14.0, 6.0]) < 0.15
    assert np.median(error[2:]) < 0.5


def test_what_a_sample_does_not_show_is_not_taught() -> None:
    points, boxes, velocity = drive()
    config = EncoderConfig(0.6, 16, (16, 16, 16), (1, 1, 1), 16, sweeps=2, head="street", layout="sparse", apart=True)
    batch = collate([pillarize(points, BevGrid(GRID.x_m, GRID.y_m, 0.6), config.pillars)])
    net = DetectorNet(config)
    features = net.encoder(batch)
    for shown in (True, False):
        true = make_targets(boxes, velocity, np.zeros(4, np.int64), GRID, moves=shown)
        shared, _ = net.head.heat(features)
        seen = found_boxes(net.head, features, shared, 20 * (true.heat - 0.5), true)
        assert (seen.moves == 0).all() or shown
