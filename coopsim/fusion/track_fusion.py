"""Track-to-track fusion: two agents' tracks in one frame become one set, each object at most once."""

from __future__ import annotations

import numpy as np

from coopsim.fusion.covariance_intersection import covariance_intersection
from coopsim.geometry.box_matching import match_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import wrap_angle
from coopsim.types import Ints, Tracks
from coopsim.types.track_estimates import TrackEstimates


def fuse_tracks(own: TrackEstimates, other: TrackEstimates, gate: float) -> tuple[TrackEstimates, Ints]:
    """Match tracks of the same class (Hungarian, BEV GIoU), intersect the pairs, add the rest.

    Positions are not compared by their covariance: the velocity of a track that has just begun is unknown, so as soon
    as it is predicted it would match everything around it.

    Args:
        own: N tracks; they keep their ids and their order.
        other: M tracks of another agent, in the same frame at the same time.
        gate: smallest BEV GIoU of two tracks of one object, in [-1, 1].

    Returns:
        The fused tracks (N + new,) and the row (M,) of each of the other agent's tracks among them.
    """
    a, b = own.tracks, other.tracks
    mine, theirs = match_boxes(a.boxes, a.label, b.boxes, b.label, gate)
    unmatched = np.ones(len(other), dtype=bool)
    unmatched[theirs] = False
    new = np.flatnonzero(unmatched)
    where = np.empty(len(other), dtype=np.int64)
    where[theirs], where[new] = mine, len(own) + np.arange(len(new))
    if not len(mine):
        return TrackEstimates.concatenate([own, other[new]]), where
    whole = TrackEstimates.concatenate([own, other[new], _intersected(own[mine], other[theirs])])
    order = np.arange(len(own) + len(new))
    order[mine] = len(order) + np.arange(len(mine))
    return whole[order], where


def _intersected(first: TrackEstimates, second: TrackEstimates) -> TrackEstimates:
    """Fuse each pair: planar states by covariance intersection, height and size by the same weight.

    The heading is averaged as an axis and the front of the first's box stays in front: a mean of headings would turn
    around where the two confuse front and back. The score is the better one.
    """
    mean, covariance, weight = covariance_intersection(first.mean, first.covariance, second.mean, second.covariance)
    a, b = first.tracks.boxes, second.tracks.boxes
    first_weight = weight[:, None]
    turn = (b.yaw - a.yaw + np.pi / 2) % np.pi - np.pi / 2
    boxes = Boxes3D.trusted(
        first_weight * a.center + (1 - first_weight) * b.center,
        first_weight * a.size + (1 - first_weight) * b.size,
        wrap_angle(a.yaw + (1 - weight) * turn),
    )
    score = np.maximum(first.tracks.score, second.tracks.score)
    tracks = Tracks.trusted(first.tracks.id, boxes, first.tracks.velocity, score, first.tracks.label)
    return TrackEstimates.trusted(tracks, covariance).with_planar_states(mean, covariance)
