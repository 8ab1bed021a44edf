"""Refinement of the boxes of several agents on one graph (Graph Lap-CoMOT), as functions of arrays.

The boxes that all agents report in one frame are the graph's vertices. Each has an anchor: its place judged by the
other agents' boxes of the same object. Refinement moves the vertices towards their anchors and preserves their
differences to their neighbours.

    `group` boxes by object -> `anchors_aos`, or `anchors_tsa` per stage -> `refine` or `refine_sparse`

Source: Damanaki, Piperigkos, Gkillas and Lalos, "Optimizing Cooperative Multi-Object Tracking using Graph Signal
Processing", eq. 8-13. There are two agents there; here any number.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from coopsim.fusion.pooling import match_agents
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints


def refine(center: Floats, anchor: Floats) -> Floats:
    """Solve the fully connected graph, in closed form and O(N) (eq. 8-10).

    Of |L v - L x|^2 + |v - a|^2 with L = N I - 1 1^T the minimum is, for each axis,

        v = x + mean(a - x) + (a - x - mean(a - x)) / (N^2 + 1)

    because L^T L + I has the eigenvalue 1 for the common shift of all vertices and N^2 + 1 for all else. So every box
    moves by the mean anchor offset, plus its own deviation from it, which vanishes as 1/N^2: among 10 boxes, 1 % of it
    is left. A fully connected graph moves all boxes together, and hardly any box to its own anchor; `refine_sparse`
    does more.

    All are (N, 3) m: centres x, anchors a, and the result v.
    """
    offset = anchor - center
    shared: Floats = offset.sum(axis=0) / max(len(offset), 1)
    return center + shared + (offset - shared) / (len(offset) ** 2 + 1)


def refine_sparse(center: Floats, anchor: Floats, adjacency: csr_array) -> Floats:
    """Solve the same problem (eq. 8-10) on any graph: (L^T L + I) (v - x) = a - x.

    The mean anchor offset of a connected part is applied in full; a component of the offsets with an eigenvalue e of L
    is applied by 1/(e^2 + 1): few neighbours, small eigenvalues. A box without neighbours goes to its anchor.

    The adjacency (N, N) is symmetric, 1 where two vertices are connected, as from `nearest_graph`.
    """
    if not len(center):
        return center.copy()
    laplacian = diags_array(adjacency.sum(axis=1)) - adjacency
    system = csc_array(laplacian.T @ laplacian + eye_array(len(center)))
    moved: Floats = splu(system).solve(anchor - center)
    return center + moved


def nearest_graph(center: Floats, count: int) -> csr_array:
    """Connect each vertex (N, 3) to its `count` nearest ones, in both directions; (N, N) of 0 and 1."""
    if len(center) < 2:
        return _graph(np.zeros((0, 2), dtype=np.int64), len(center))
    # A vertex is its own nearest, or as near as any: it is queried too, and removed in the end.
    _, nearest = KDTree(center).query(center, k=min(count + 1, len(center)))
    return _graph(np.column_stack([np.repeat(np.arange(len(center)), nearest.shape[1]), nearest.ravel()]), len(center))


def group(boxes: Floats, agent: Ints, threshold: float, label: Ints) -> Ints:
    """Group the boxes of one object: every two agents' boxes are matched by 3D IoU (Hungarian), and matches are joined.

    A group has at most one box of each agent. Where chains of matches contradict that, the best matches count. With two
    agents a group is a matched pair or a single box.

    Boxes (N, 7) are in one frame; agents (N,) may have any numbers, and classes (N,) never mix. The threshold is > 0.
    Return the group (N,) of each box, numbered from 0 in order of their first boxes.
    """
    names, owner = np.unique(agent, return_inverse=True)
    pairs, value = match_agents(boxes, owner, label, threshold)
    first_box = _join(pairs[np.argsort(-value, kind="stable")], owner, len(names))
    return np.unique(first_box, return_inverse=True)[1].astype(np.int64)


def anchors_aos(center: Floats, group: Ints) -> Floats:
    """Return the anchors (N, 3) for all in one stage (AOS): the mean of a box's partners, or its own position.

    With two agents matched boxes take each other's position (eq. 11). Centres are (N, 3) m, groups (N,) from `group`.
    """
    partners = np.bincount(group) - 1
    total = np.zeros((len(partners), 3))
    np.add.at(total, group, center)
    shared = partners[group] > 0
    return np.where(shared[:, None], (total[group] - center) / np.maximum(partners[group], 1)[:, None], center)


def anchors_tsa(center: Floats, group: Ints, agent: Ints, source: int) -> Floats:
    """Return the anchors (N, 3) of one stage (TSA): for a whole group the box of agent `source`, else its position.

    There are as many stages as agents, each with another source. With two agents i and j the first stage has j's
    boxes as anchors (eq. 12), the second i's (eq. 13).

    Centres are (N, 3) m, groups (N,) from `group`, and agents (N,) numbers, of which `source` has the anchors.
    """
    anchoring = np.flatnonzero(agent == source)
    anchor_of = np.full(group.max(initial=-1) + 1, -1)
    anchor_of[group[anchoring]] = anchoring
    anchored = anchor_of[group]
    return center[np.where(anchored >= 0, anchored, np.arange(len(center)))]


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
