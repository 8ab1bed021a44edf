"""Poses from shared objects: exact without noise, robust against outliers, and nothing where nothing is shared."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from coopsim.fusion import pose_graph
from coopsim.fusion.common_objects import ANYTHING, PlacedBoxes, common_objects, consensus, turned
from coopsim.fusion.pose_graph import Corrections, PoseGraph, align

SEEDS = st.integers(0, 10_000)
UNSURE = np.diag(np.square([1.0, 1.0, 0.03]))


def scattered(rng: np.random.Generator, count: int) -> np.ndarray:
    """Positions (count, 2) m, none closer than 4 m to another."""
    grid = np.stack(np.meshgrid(np.arange(-40, 41, 8.0), np.arange(-40, 41, 8.0)), axis=-1).reshape(-1, 2)
    chosen: np.ndarray = rng.permutation(grid)[:count] + rng.uniform(-2, 2, (count, 2))
    return chosen


def displaced(objects: np.ndarray, origin: np.ndarray, error: np.ndarray) -> PlacedBoxes:
    """Objects as an agent places them that is at `origin`, and believes what `error` corrects."""
    believed = origin - error[:2]
    seen = believed + turned(objects - origin, -float(error[2]))
    return PlacedBoxes(believed, seen, np.zeros(len(objects), dtype=int))


def graph_of(agents: list[PlacedBoxes], rows: list[np.ndarray]) -> PoseGraph:
    """All agents' boxes, where row k of an agent is on object rows[agent][k]."""
    agent = np.repeat(np.arange(len(agents)), [len(seen) for seen in agents])
    number, origin = np.concatenate(rows), np.array([seen.origin for seen in agents])[agent]
    order = np.argsort(number, kind="stable")
    offset = np.concatenate([seen.position for seen in agents]) - origin
    dense = np.unique(number, return_inverse=True)[1]
    return PoseGraph(offset[order], origin[order], agent[order], dense[order])


def unknown(count: int, scale: float = 1.0) -> Corrections:
    return Corrections(np.zeros((count, 3)), np.broadcast_to(UNSURE * scale, (count, 3, 3)))


@settings(max_examples=15)
@given(seed=SEEDS, count=st.integers(4, 30))
def test_errors_of_a_metre_and_a_degree_are_found_and_taken_back(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    objects, origin = scattered(rng, count), rng.uniform(-30, 30, 2)
    error = rng.uniform(-1, 1, 3) * [1.0, 1.0, np.radians(1)]
    seen, receiver = displaced(objects, origin, error), PlacedBoxes(np.zeros(2), objects, np.zeros(count, dtype=int))
    rough = consensus(receiver.position, receiver.label, seen, np.zeros(3), np.sqrt(np.diagonal(UNSURE)))
    common = common_objects([receiver, seen], [np.zeros(3), rough], 2.0)
    assert np.array_equal(common.row[common.agent == 1], common.row[common.agent == 0])
    found = align(graph_of([receiver, seen], [np.arange(count)] * 2), unknown(1, 1e6), 0.1)
    np.testing.assert_allclose(found.mean[0], error, atol=1e-4)


def test_the_solution_is_that_of_a_general_solver() -> None:
    """The same objective, minimised over poses and objects together by scipy."""
    rng = np.random.default_rng(0)
    objects, noise_m = scattered(rng, 9), 0.2
    errors = rng.normal(size=(2, 3)) * [0.3, 0.3, 0.005]
    agents = [displaced(objects, np.zeros(2), np.zeros(3))]
    agents += [displaced(objects, rng.uniform(-20, 20, 2), error) for error in errors]
    agents = [PlacedBoxes(a.origin, a.position + rng.normal(0, 0.05, a.position.shape), a.label) for a in agents]
    graph, prior = graph_of(agents, [np.arange(9)] * 3), unknown(2)
    mean = prior.mean
    for _ in range(8):  # continued until it is settled
        mean = align(graph, Corrections(mean, prior.covariance * 1e9), noise_m).mean

    def objective(x: np.ndarray) -> float:
        poses, where = np.vstack([np.zeros(3), x[:6].reshape(2, 3)]), x[6:].reshape(9, 2)
        cos, sin = np.cos(poses[graph.agent, 2]), np.sin(poses[graph.agent, 2])
        arm = np.column_stack([graph.offset[:, 0] * cos - graph.offset[:, 1] * sin, graph.offset[:, 1] * cos])
        arm[:, 1] += graph.offset[:, 0] * sin
        apart = graph.origin + poses[graph.agent, :2] + arm - where[graph.object]
        return float(np.log1p((apart**2).sum(axis=1) / noise_m**2).sum())

    best = minimize(objective, np.concatenate([mean.ravel(), objects.ravel()]), method="BFGS", options={"gtol": 1e-3})
    assert (np.abs(mean - best.x[:6].reshape(2, 3)) < [0.015, 0.015, 0.001]).all()
    assert np.abs(mean - errors).max() < 0.1  # boxes are 5 cm off, and nine of them see it


@settings(max_examples=10)
@given(seed=SEEDS, angle=st.floats(-3.1, 3.1))
def test_turning_and_moving_the_world_turns_the_corrections(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    objects, error = scattered(rng, 8), rng.normal(size=3) * [0.4, 0.4, 0.01]
    agents = [displaced(objects, np.zeros(2), np.zeros(3)), displaced(objects, np.array([9.0, -4]), error)]
    moved = [PlacedBoxes(turned(a.origin[None], angle)[0] + 7, turned(a.position, angle) + 7, a.label) for a in agents]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pose_graph, "_SETTLED", 0.0)  # or rounding decides whether one of the two takes a step more
        one, other = (align(graph_of(each, [np.arange(8)] * 2), unknown(1), 0.2).mean[0] for each in (agents, moved))
    np.testing.assert_allclose(turned(one[None, :2], angle)[0], other[:2], atol=1e-6)
    np.testing.assert_allclose(one[2], other[2], atol=1e-8)


def test_a_quarter_of_wrong_pairs_hardly_matters() -> None:
    rng = np.random.default_rng(0)
    objects, error = scattered(rng, 16), np.array([0.4, -0.3, 0.008])
    receiver, seen = displaced(objects, np.zeros(2), np.zeros(3)), displaced(objects, np.array([10.0, 5]), error)
    position = seen.position.copy()
    position[:4] += [1.5, 0.5]
    wrong = PlacedBoxes(seen.origin, position, seen.label)
    found = align(graph_of([receiver, wrong], [np.arange(16)] * 2), unknown(1), 0.15).mean[0]
    assert np.abs(found[:2] - error[:2]).max() < 0.1  # the plain mean would be off by a quarter of 1.5 m
    assert abs(found[2] - error[2]) < 0.004


def test_with_nothing_in_common_the_prior_stays() -> None:
    rng = np.random.default_rng(1)
    near, far = scattered(rng, 6), scattered(rng, 6) + 500
    mean = np.array([[0.2, -0.1, 0.003]])
    prior = Corrections(mean, UNSURE[None])
    receiver, seen = displaced(near, np.zeros(2), np.zeros(3)), displaced(far, np.zeros(2), np.zeros(3))
    assert not len(common_objects([receiver, seen], [np.zeros(3)] * 2, 2.0).agent)
    found = align(graph_of([receiver, seen], [np.arange(6), 6 + np.arange(6)]), prior, 0.2)
    np.testing.assert_allclose(found.mean, mean, atol=1e-12)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-9)
    rough = consensus(receiver.position, receiver.label, seen, mean[0], np.sqrt(np.diagonal(UNSURE)))
    np.testing.assert_array_equal(rough, mean[0])


def test_one_pair_alone_does_not_outweigh_three_sigmas() -> None:
    seen = PlacedBoxes(np.zeros(2), np.array([[10.0, 0]]), np.zeros(1, dtype=int))
    sigma = np.array([0.5, 0.5, 0.001])
    rough = consensus(np.array([[11.4, 0.0]]), np.zeros(1, dtype=int), seen, np.zeros(3), sigma)
    np.testing.assert_array_equal(rough, np.zeros(3))
    near = consensus(np.array([[10.5, 0.0]]), np.zeros(1, dtype=int), seen, np.zeros(3), sigma)
    assert 0 <= near[0] <= 0.5 + 1e-9


def test_classes_do_not_match_each_other_but_an_agent_itself_may_be_anything() -> None:
    where = np.array([[5.0, 0], [15.0, 0]])
    mine = PlacedBoxes(np.zeros(2), where, np.array([0, 3]))
    theirs = PlacedBoxes(np.zeros(2), where, np.array([2, ANYTHING]))
    common = common_objects([mine, theirs], [np.zeros(3)] * 2, 1.0)
    assert common.row.tolist() == [1, 1] and common.agent.tolist() == [0, 1]


def test_what_two_senders_see_helps_although_the_receiver_does_not() -> None:
    rng = np.random.default_rng(2)
    objects = scattered(rng, 20)
    errors = np.array([[0.5, 0.2, 0.0], [-0.6, 0.4, 0.0]])
    receiver = displaced(objects[:10], np.zeros(2), np.zeros(3))
    first = displaced(objects, np.array([20.0, 0]), errors[0])
    second = displaced(objects[10:], np.array([-20.0, 0]), errors[1])
    graph = graph_of([receiver, first, second], [np.arange(10), np.arange(20), 10 + np.arange(10)])
    np.testing.assert_allclose(align(graph, unknown(2, 1e4), 0.2).mean, errors, atol=1e-3)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_boxes(count: int) -> None:
    seen = PlacedBoxes(np.zeros(2), np.ones((count, 2)) * np.arange(count)[:, None] * 9, np.zeros(count, dtype=int))
    none = PlacedBoxes(np.zeros(2), np.zeros((0, 2)), np.zeros(0, dtype=int))
    sigma = np.ones(3)
    assert np.isfinite(consensus(seen.position, seen.label, seen, np.zeros(3), sigma)).all()
    np.testing.assert_array_equal(consensus(none.position, none.label, seen, np.zeros(3), sigma), np.zeros(3))
    assert len(common_objects([seen, none, seen], [np.zeros(3)] * 3, 1.0).agent) == 2 * count
