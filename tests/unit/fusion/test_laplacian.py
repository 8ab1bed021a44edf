"""Graph refinement: the closed form against a solver, groups and anchors against cases worked out by hand."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from coopsim.fusion import laplacian as graphs
from coopsim.fusion.laplacian import nearest_graph, refine, refine_sparse
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

points = st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (2, n, 3), elements=st.floats(-100, 100)))


def group(boxes: Floats, agent: ArrayLike, threshold: float, label: ArrayLike | None = None) -> Ints:
    labels = np.zeros(len(boxes), dtype=np.int64) if label is None else np.asarray(label, dtype=np.int64)
    return graphs.group(boxes, np.asarray(agent, dtype=np.int64), threshold, labels)


def anchors_aos(center: Floats, index: ArrayLike) -> Floats:
    return graphs.anchors_aos(center, np.asarray(index, dtype=np.int64))


def anchors_tsa(center: Floats, index: ArrayLike, agent: ArrayLike, source: int) -> Floats:
    indices, agents = np.asarray(index, dtype=np.int64), np.asarray(agent, dtype=np.int64)
    return graphs.anchors_tsa(center, indices, agents, source)


def solved(center: np.ndarray, anchor: np.ndarray, adjacency: np.ndarray) -> np.ndarray:
    """The stacked system of eq. 8, by a general least-squares solver."""
    laplacian = np.diag(adjacency.sum(axis=1)) - adjacency
    stacked = np.concatenate([laplacian, np.eye(len(center))])
    return np.linalg.lstsq(stacked, np.concatenate([laplacian @ center, anchor]))[0]


def cars(*xs: float) -> np.ndarray:
    return np.array([[x, 0, 0, 4, 2, 1.5, 0] for x in xs], dtype=float).reshape(-1, 7)


@given(points)
def test_the_closed_form_solves_the_fully_connected_graph(both: np.ndarray) -> None:
    center, anchor = both
    expected = solved(center, anchor, 1 - np.eye(len(center)))
    np.testing.assert_allclose(refine(center, anchor), expected, atol=1e-9)


def within(center: np.ndarray, radius_m: float) -> csr_array:
    """The graph that connects what is at most so far apart."""
    points = np.reshape(center, (-1, 3))
    apart_m = np.linalg.norm(points[:, None] - points, axis=2)
    return csr_array((apart_m <= radius_m) & ~np.eye(len(points), dtype=bool), dtype=float)


@given(points, st.integers(1, 4), st.floats(1, 80))
def test_any_graph_is_solved(both: np.ndarray, count: int, radius_m: float) -> None:
    center, anchor = both
    for graph in (nearest_graph(center, count), within(center, radius_m)):
        np.testing.assert_allclose(
            refine_sparse(center, anchor, graph), solved(center, anchor, graph.toarray()), atol=1e-9
        )


@given(points)
def test_a_graph_that_reaches_all_is_the_fully_connected_one(both: np.ndarray) -> None:
    center, anchor = both
    expected = refine(center, anchor)
    for graph in (nearest_graph(center, len(center)), within(center, 1e3)):
        np.testing.assert_allclose(refine_sparse(center, anchor, graph), expected, atol=1e-9)


def test_what_a_fully_connected_graph_does_to_ten_boxes() -> None:
    """One anchor is 1 m off: all move by 10 cm, and the box itself by the 101st part of the rest more."""
    offset = np.zeros((10, 3))
    offset[3, 0] = 1.0
    moved = refine(np.zeros((10, 3)), offset)[:, 0]
    np.testing.assert_allclose(moved[3], 0.1 + 0.9 / 101)
    np.testing.assert_allclose(np.delete(moved, 3), 0.1 - 0.1 / 101)


def test_one_box_goes_to_its_anchor() -> None:
    anchor = [[1.0, 2, 3]]
    np.testing.assert_allclose(refine(np.zeros((1, 3)), anchor), anchor)
    np.testing.assert_allclose(refine_sparse(np.zeros((1, 3)), anchor, nearest_graph(np.zeros((1, 3)), 5)), anchor)


def test_graphs_by_hand() -> None:
    center = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [9, 0, 0]])
    line = np.array([[0, 1, 0, 0], [1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0]])
    np.testing.assert_array_equal(nearest_graph(center, 1).toarray(), line)
    same = np.zeros((5, 3))
    graph = nearest_graph(same, 2).toarray()
    assert (graph == graph.T).all() and (np.diag(graph) == 0).all() and (graph.sum(axis=1) >= 2).all()


def test_two_agents_group_in_pairs() -> None:
    boxes, agent = cars(0, 20, 40, 20.5, 60, 0.5), [0, 0, 0, 1, 1, 1]
    np.testing.assert_array_equal(group(boxes, agent, 0.3), [0, 1, 2, 1, 3, 0])
    np.testing.assert_array_equal(group(boxes, agent, 0.9), [0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(group(boxes, agent, 0.3, label=[0, 1, 0, 0, 0, 0]), [0, 1, 2, 3, 4, 0])


def test_chains_join_more_than_two_agents() -> None:
    """Agents 7 and 2 hardly overlap; that both match agent 5 is enough."""
    boxes = cars(0, 1.8, 3.6, 50)
    assert iou_3d(boxes[:1], boxes[2:3])[0, 0] < 0.1
    np.testing.assert_array_equal(group(boxes, [7, 5, 2, 2], 0.3), [0, 0, 0, 1])


def test_a_group_has_one_box_of_each_agent() -> None:
    """A chain 0 - 1 - 2 - 0 would join two boxes of agent 0: its weakest match gives way."""
    boxes, agent = cars(0, 1.0, 2.1, 3.3), [0, 1, 2, 0]
    np.testing.assert_array_equal(group(boxes, agent, 0.3), [0, 0, 0, 1])


@st.composite
def crowds(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    xs = draw(st.lists(st.floats(0, 12), min_size=0, max_size=12, unique=True))
    agent = draw(st.lists(st.integers(0, 3), min_size=len(xs), max_size=len(xs)))
    return cars(*xs), np.array(agent, dtype=int)


@given(crowds(), st.floats(0.05, 0.9))
def test_groups_hold_no_agent_twice_and_are_numbered_in_order(
    crowd: tuple[np.ndarray, np.ndarray], threshold: float
) -> None:
    boxes, agent = crowd
    index = group(boxes, agent, threshold)
    assert len({*zip(index, agent, strict=True)}) == len(boxes)
    first = list(dict.fromkeys(index.tolist()))
    assert first == list(range(len(first)))


def test_names_and_order_of_agents_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        boxes, agent = cars(*rng.uniform(0, 30, 24)), rng.integers(0, 4, 24)
        renamed = np.array([40, 7, -3, 12])[agent]
        np.testing.assert_array_equal(group(boxes, renamed, 0.3), group(boxes, agent, 0.3))


def test_anchors_of_two_agents_are_those_of_the_paper() -> None:
    """Boxes 0 and 2 (of agent 0) match 3 and 4 (of agent 1); 1 and 5 are alone."""
    center, agent, index = np.arange(18.0).reshape(6, 3), [0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 2, 3]
    np.testing.assert_array_equal(anchors_aos(center, index), center[[3, 1, 4, 0, 2, 5]])  # eq. 11
    np.testing.assert_array_equal(anchors_tsa(center, index, agent, 1), center[[3, 1, 4, 3, 4, 5]])  # eq. 12
    np.testing.assert_array_equal(anchors_tsa(center, index, agent, 0), center[[0, 1, 2, 0, 2, 5]])  # eq. 13


def test_anchors_of_three_agents() -> None:
    center, agent, index = np.diag([3.0, 6, 9]), [0, 1, 2], [0, 0, 0]
    np.testing.assert_allclose(anchors_aos(center, index), [[0, 3, 4.5], [1.5, 0, 4.5], [1.5, 3, 0]])
    for source in agent:
        np.testing.assert_array_equal(anchors_tsa(center, index, agent, source), center[[source] * 3])
    np.testing.assert_array_equal(anchors_tsa(center, index, agent, 9), center)  # it reported nothing


@given(points)
def test_swapped_anchors_leave_the_mean_where_it_is(both: np.ndarray) -> None:
    center = both.reshape(-1, 3)
    index = np.tile(np.arange(both.shape[1]), 2)
    refined = refine(center, anchors_aos(center, index))
    np.testing.assert_allclose(refined.mean(axis=0), center.mean(axis=0), atol=1e-9)


def test_no_boxes() -> None:
    nothing = np.zeros((0, 3))
    index = group(cars(), [], 0.5)
    assert index.shape == (0,) and index.dtype == np.int64
    for result in (
        refine(nothing, nothing),
        refine_sparse(nothing, nothing, within(nothing, 5.0)),
        refine_sparse(nothing, nothing, nearest_graph(nothing, 3)),
        anchors_aos(nothing, index),
        anchors_tsa(nothing, index, [], 0),
    ):
        assert result.shape == (0, 3)
