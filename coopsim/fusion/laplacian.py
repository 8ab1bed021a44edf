"""Refinement of the boxes of several agents on one graph (Graph Lap-CoMOT), as functions of arrays.

The boxes that all agents report in one frame are the graph's vertices. Each has an anchor: its place judged by the
other agents' boxes of the same object. Refinement moves the vertices towards their anchors and preserves their
differences to their neighbours.

    `group` boxes by object -> `anchors_aos`, or `anchors_tsa` per stage -> `refine` or `refine_sparse`

Source: Damanaki, Piperigkos, Gkillas and Lalos, "Optimizing Cooperative Multi-Object Tracking using Graph Signal
Processing", eq. 8-13. There are two agents there; here any number.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from coopsim.errors import InvalidValueError
from coopsim.fusion.pooling import match_agents
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.support.checks import require_count
from coopsim.support.kernels import njit
from coopsim.types import Ints

Kernel = Callable[[ArrayLike, ArrayLike], Floats]
"""Boxes (N, 7) and (M, 7) to (N, M), larger is better."""


def refine(center: ArrayLike, anchor: ArrayLike) -> Floats:
    """Solve the fully connected graph, in closed form and O(N) (eq. 8-10).

    Of |L v - L x|^2 + |v - a|^2 with L = N I - 1 1^T the minimum is, for each axis,

        v = x + mean(a - x) + (a - x - mean(a - x)) / (N^2 + 1)

    because L^T L + I has the eigenvalue 1 for the common shift of all vertices and N^2 + 1 for all else. So every box
    moves by the mean anchor offset, plus its own deviation from it, which vanishes as 1/N^2: among 10 boxes, 1 % of it
    is left. A fully connected graph moves all boxes together, and hardly any box to its own anchor; `refine_sparse`
    does more.

    All are (N, 3) m: centres x, anchors a, and the result v.
    """
    where, offset = _offset(center, anchor)
    shared: Floats = offset.sum(axis=0) / max(len(offset), 1)
    return where + shared + (offset - shared) / (len(offset) ** 2 + 1)


def refine_sparse(center: ArrayLike, anchor: ArrayLike, adjacency: csr_array) -> Floats:
    """Solve the same problem (eq. 8-10) on any graph: (L^T L + I) (v - x) = a - x.

    The mean anchor offset of a connected part is applied in full; a component of the offsets with an eigenvalue e of L
    is applied by 1/(e^2 + 1): few neighbours, small eigenvalues. A box without neighbours goes to its anchor.

    The adjacency (N, N) is symmetric, 1 where two vertices are connected, as from `nearest_graph`.
    """
    where, offset = _offset(center, anchor)
    if adjacency.shape != (len(where), len(where)):
        raise InvalidValueError(f"adjacency must have shape {(len(where),) * 2}, got {adjacency.shape}")
    if not len(where):
        return where.copy()
    laplacian = diags_array(adjacency.sum(axis=1)) - adjacency
    system = csc_array(laplacian.T @ laplacian + eye_array(len(where)))
    moved: Floats = splu(system).solve(offset)
    return where + moved


def nearest_graph(center: ArrayLike, count: int) -> csr_array:
    """Connect each vertex (N, 3) to its `count` nearest ones, in both directions; (N, N) of 0 and 1."""
    require_count(1, count=count)
    points = frozen(center, (None, 3), np.float64, "center")
    if len(points) < 2:
        return _graph(np.zeros((0, 2), dtype=np.int64), len(points))
    # A vertex is its own nearest, or as near as any: it is queried too, and removed in the end.
    _, nearest = KDTree(points).query(points, k=min(count + 1, len(points)))
    return _graph(np.column_stack([np.repeat(np.arange(len(points)), nearest.shape[1]), nearest.ravel()]), len(points))


def group(
    boxes: ArrayLike, agent: ArrayLike, threshold: float, *, label: ArrayLike | None = None, kernel: Kernel = iou_3d
) -> Ints:
    """Group the boxes of one object: every two agents' boxes are matched (Hungarian), and matches are joined.

    A group has at most one box of each agent. Where chains of matches contradict that, the best matches count. With two
    agents a group is a matched pair or a single box.

    Boxes (N, 7) are in one frame; agents (N,) may have any numbers, and classes (N,) never mix. The threshold, the
    smallest affinity of a match, is > 0 for `iou_3d`, because boxes far apart have 0. Return the group (N,) of each
    box, numbered from 0 in order of their first boxes.
    """
    rows = frozen(boxes, (None, 7), np.float64, "boxes")
    names, owner = np.unique(frozen(agent, (len(rows),), np.int64, "agent"), return_inverse=True)
    classes = np.zeros(len(rows), dtype=np.int64) if label is None else frozen(label, (len(rows),), np.int64, "label")
    if kernel is iou_3d and threshold > 0 and np.isfinite(rows).all():
        pairs, value = match_agents(rows, owner, classes, threshold)
    else:
        pairs, value = _match_all_pairs(rows, owner, classes, threshold, kernel)
    first_box = _join(pairs[np.argsort(-value, kind="stable")], owner, len(names))
    return np.unique(first_box, return_inverse=True)[1].astype(np.int64)


def _match_all_pairs(
    boxes: Floats, owner: Ints, classes: Ints, threshold: float, kernel: Kernel
) -> tuple[Ints, Floats]:
    """Match the boxes of every two agents as `match_agents` does, by any affinity."""
    own = [np.flatnonzero(owner == k) for k in range(owner.max(initial=-1) + 1)]
    pairs, values = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
    for mine, theirs in combinations(own, 2):
        affinity = kernel(boxes[mine], boxes[theirs])
        affinity = np.where(classes[mine, None] == classes[theirs], affinity, -np.inf)
        row, column = hungarian(affinity, threshold)
        pairs.append(np.column_stack([mine[row], theirs[column]]))
        values.append(affinity[row, column])
    return np.concatenate(pairs), np.concatenate(values)


def anchors_aos(center: ArrayLike, group: ArrayLike) -> Floats:
    """Return the anchors (N, 3) for all in one stage (AOS): the mean of a box's partners, or its own position.

    With two agents matched boxes take each other's position (eq. 11). Centres are (N, 3) m, groups (N,) from `group`.
    """
    points, index = _grouped(center, group)
    partners = np.bincount(index) - 1
    total = np.zeros((len(partners), 3))
    np.add.at(total, index, points)
    shared = partners[index] > 0
    return np.where(shared[:, None], (total[index] - points) / np.maximum(partners[index], 1)[:, None], points)


def anchors_tsa(center: ArrayLike, group: ArrayLike, agent: ArrayLike, source: int) -> Floats:
    """Return the anchors (N, 3) of one stage (TSA): for a whole group the box of agent `source`, else its position.

    There are as many stages as agents, each with another source. With two agents i and j the first stage has j's
    boxes as anchors (eq. 12), the second i's (eq. 13).

    Centres are (N, 3) m, groups (N,) from `group`, and agents (N,) numbers, of which `source` has the anchors.
    """
    points, index = _grouped(center, group)
    anchoring = np.flatnonzero(frozen(agent, (len(points),), np.int64, "agent") == source)
    anchor_of = np.full(index.max(initial=-1) + 1, -1)
    anchor_of[index[anchoring]] = anchoring
    anchored = anchor_of[index]
    return points[np.where(anchored >= 0, anchored, np.arange(len(points)))]


def _offset(center: ArrayLike, anchor: ArrayLike) -> tuple[Floats, Floats]:
    where = frozen(center, (None, 3), np.float64, "center")
    return where, frozen(anchor, where.shape, np.float64, "anchor") - where


def _grouped(center: ArrayLike, group: ArrayLike) -> tuple[Floats, Ints]:
    points = frozen(center, (None, 3), np.float64, "center")
    return points, frozen(group, (len(points),), np.int64, "group")


def _graph(edges: Ints, count: int) -> csr_array:
    """Return the adjacency (N, N) of edges (E, 2), which may be doubled, in both directions, or loops."""
    loose = edges[edges[:, 0] != edges[:, 1]]
    ends = np.unique(np.concatenate([loose, loose[:, ::-1]]), axis=0)
    return coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr()


@njit(cache=True, nogil=True)
def _join(pairs: Ints, owner: Ints, agents: int) -> Ints:
    """Unite the groups of pairs in turn, unless both have a box of one agent; return each group's first box (N,)."""
    member = np.full((len(owner), agents), -1)  # of the group whose first box is the row: the box of each agent
    first = np.arange(len(owner))
    for box in range(len(owner)):
        member[box, owner[box]] = box
    for k in range(len(pairs)):
        low, high = first[pairs[k, 0]], first[pairs[k, 1]]
        low, high = min(low, high), max(low, high)
        if low == high or _share_an_agent(member, low, high):
            continue
        for agent in range(agents):
            box = member[high, agent]
            if box >= 0:
                member[low, agent], first[box] = box, low
    return first


@njit(cache=True, nogil=True)
def _share_an_agent(member: Ints, low: int, high: int) -> bool:
    for agent in range(member.shape[1]):  # noqa: SIM110  (numba has no generators)
        if member[low, agent] >= 0 and member[high, agent] >= 0:
            return True
    return False
