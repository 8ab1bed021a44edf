"""Motions of boxes from two sweeps: what counts, likeness at each shift, and velocities that were never taught."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coopsim.learn.losses.street_losses import motion_loss
from coopsim.nn.detector import sweep_motion
from coopsim.nn.detector.sweep_motion import COLUMNS, ROWS, BoxSweeps, SweepMotion, box_sweeps, over_ground

torch.set_num_threads(1)
CAR = np.array([4.6, 1.9, 1.6])


def drive(boxes: np.ndarray, velocity: np.ndarray, rng: np.random.Generator, age_s: float = 0.1) -> np.ndarray:
    """Return points (P, 5) of two sweeps of boxes (N, 7): 40 on each one's sides, with errors of 3 cm."""
    clouds, on = [], rng.uniform(-0.5, 0.5, (len(boxes), 40, 3))
    on[:, :20, 0], on[:, 20:, 1] = np.sign(on[:, :20, 0]) / 2, np.sign(on[:, 20:, 1]) / 2
    for age in (0.0, age_s):
        at = on * boxes[:, None, 3:6] + rng.normal(0, 0.03, on.shape)
        cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
        xy = np.stack([cos * at[..., 0] - sin * at[..., 1], sin * at[..., 0] + cos * at[..., 1]], axis=-1)
        xy += (boxes[:, :2] - age * velocity)[:, None]
        z, rest = at[..., 2] + boxes[:, None, 2], np.full((*at.shape[:2], 2), [0.5, age])
        clouds.append(np.concatenate([xy, z[..., None], rest], axis=-1).reshape(-1, 5))
    return np.concatenate(clouds).astype(np.float32)


def cars(rng: np.random.Generator, low_yaw: float, high_yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return twelve cars (N, 7), apart from each other, and their velocities (N, 2): some stand."""
    middle = 20.0 * np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)
    yaw, speed = rng.uniform(low_yaw, high_yaw, 12), rng.uniform(-20.0, 20.0, 12) * (rng.random(12) < 0.7)
    boxes = np.column_stack([middle, np.full(12, 0.8), np.tile(CAR, (12, 1)), yaw])
    return boxes, speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])


def test_sweeps_around_a_box_do_not_depend_on_its_heading() -> None:
    box = np.array([[0.0, 0.0, 0.8, *CAR, 0.0]])
    points = drive(box, np.array([[9.0, 0.5]]), np.random.default_rng(0))
    there = points.copy()
    there[:, :2] = over_ground(points[:, :2].astype(np.float64), np.full(len(points), 2.0))
    there[:, :2] += [30.0, -7.0]
    one = box_sweeps(points, box)
    other = box_sweeps(there, np.array([[30.0, -7.0, *box[0, 2:6], 2.0]]))
    assert one.counts.shape == (1, 6, ROWS, COLUMNS)
    torch.testing.assert_close(one.counts[:, :3].sum(), torch.tensor(40.0 * 0.88), atol=6.0, rtol=0)  # none below
    assert (one.counts - other.counts).abs().sum() < 0.05 * one.counts.sum()
    torch.testing.assert_close(one.cell_m_s, torch.tensor([3.0]))


def test_ground_and_crowns_do_not_count_and_ages_tell_the_sweeps_apart() -> None:
    box = np.array([[0.0, 0.0, 0.9, 0.8, 0.5, 1.8, 0.0]])
    points = np.array([[0, 0, 0.1, 0, 0], [0, 0, 1.0, 0, 0], [0, 0, 2.5, 0, 0], [0.1, 0, 1.0, 0, 0.2]], np.float32)
    sweeps = box_sweeps(points, box)
    np.testing.assert_allclose(sweeps.counts.sum((0, 2, 3)), [0, 1, 0, 0, 1, 0])
    torch.testing.assert_close(sweeps.cell_m_s, torch.tensor([0.4]))
    assert not len(box_sweeps(points, box[:0]).counts) and not box_sweeps(points[:0], box).counts.any()


def test_points_are_found_around_any_box_and_far_ones_are_left_out() -> None:
    rng = np.random.default_rng(0)
    middle = np.array([[-900.0, 3.0], [-128.0, 0.0], [-3.9, -40.0], [0.0, 0.0], [127.9, 5.0], [5000.0, 0.0]])
    boxes = np.column_stack([middle, np.full(6, 0.8), np.tile(CAR, (6, 1)), rng.uniform(-3, 3, 6)])
    points = np.concatenate([drive(boxes, np.zeros((6, 2)), rng), [[3e38, -3e38, 0.8, 0, 0]]]).astype(np.float32)
    together = box_sweeps(points, boxes).counts
    for each, box in zip(together, boxes, strict=True):
        here = points.copy()
        here[:, :2] -= box[:2].astype(np.float32)
        alone = box_sweeps(here, np.array([[0, 0, *box[2:]]])).counts[0]
        assert alone.sum() > 50
        torch.testing.assert_close(each.sum((1, 2)), alone.sum((1, 2)), atol=1.0, rtol=0)


def test_likeness_is_the_sum_of_products_at_each_shift() -> None:
    now, before = torch.rand(2, 3, 6, 14), torch.rand(2, 3, 6, 14)
    alike = sweep_motion._correlated(now, before)
    for left, along in ((0, 0), (-3, 5), (4, -13), (2, 12)):
        moved = torch.zeros_like(before)
        rows, columns = (slice(max(0, by), size + min(0, by)) for by, size in ((left, 6), (along, 14)))
        back, ago = (slice(max(0, -by), size + min(0, -by)) for by, size in ((left, 6), (along, 14)))
        moved[:, :, rows, columns] = before[:, :, back, ago]
        torch.testing.assert_close(alike[:, left + 4, along + 16], (now * moved).sum((1, 2, 3)), atol=1e-4, rtol=1e-4)


def test_what_is_learned_on_some_headings_and_speeds_holds_on_others() -> None:
    rng = np.random.default_rng(0)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        net = SweepMotion()
    adam = torch.optim.Adam(net.parameters(), lr=0.01)
    for _ in range(25):
        boxes, velocity = cars(rng, 0.0, 1.0)
        true = torch.from_numpy(over_ground(velocity, -boxes[:, 6])).float()
        loss = motion_loss(net(box_sweeps(drive(boxes, velocity, rng), boxes)), true)
        adam.zero_grad()
        loss.backward()
        adam.step()
    boxes, velocity = cars(rng, 2.0, 6.0)
    people = boxes.copy()
    people[:, 3:6] = [0.8, 0.5, 1.7]
    walk = np.sign(velocity) * 1.0
    for there, moves, fast in ((boxes, velocity, 1.0), (people, walk, 0.5)):
        backwards = there + np.pi * np.eye(7)[6] * (rng.random(len(there)) < 0.5)[:, None]
        headed, found = net.look(drive(there, moves, rng), backwards)
        speed = np.linalg.norm(moves, axis=1)
        error = np.linalg.norm(found - moves, axis=1)
        assert np.median((error / np.maximum(speed, 1e-9))[speed > fast]) < 0.2
        ahead = (moves * np.column_stack([np.cos(headed[:, 6]), np.sin(headed[:, 6])])).sum(axis=1)
        if fast == 1.0:  # a car heads to where it moves; one that stands stays as it was found
            assert (ahead[speed > 3.0] > 0).mean() > 0.8
        np.testing.assert_array_equal(headed[:, :6], there[:, :6])
    headed, found = net.look(drive(boxes, 0 * velocity, rng), boxes)
    assert np.median(np.linalg.norm(found, axis=1)) < 0.5
    np.testing.assert_allclose(headed, boxes)


def test_no_boxes_have_no_motions() -> None:
    none = BoxSweeps(torch.zeros(0, 6, ROWS, COLUMNS), torch.zeros(0))
    assert SweepMotion()(none).shape == (0, 2)


def test_motions_are_seen_from_a_box_and_from_its_other_end() -> None:
    velocity, yaw = np.array([[3.0, 4.0], [0.0, -2.0]]), np.array([0.3, -2.0])
    motion = over_ground(velocity, -yaw)
    np.testing.assert_allclose(over_ground(velocity, -(yaw + np.pi)), -motion)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
    np.testing.assert_allclose(motion[:, 0], (velocity * ahead).sum(axis=1))
    np.testing.assert_allclose(over_ground(motion, yaw), velocity)
    assert over_ground(velocity, yaw) == pytest.approx(np.stack([  # the matrix of a turn
        [np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y] for (x, y), a in zip(velocity, yaw, strict=True)
    ]))  # fmt: skip
