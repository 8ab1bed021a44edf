"""Track-to-track fusion: two agents' tracks in one frame become one set, an object at most once."""

from __future__ import annotations

import numpy as np

from coopsim.fusion.box_matching import match_boxes
from coopsim.fusion.covariance_intersection import covariance_intersection
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import wrap_angle
from coopsim.tracking.motion.track_estimates import TrackEstimates
from coopsim.types import Ints, Tracks


def fuse_tracks(held: TrackEstimates, heard: TrackEstimates, gate: float) -> tuple[TrackEstimates, Ints]:
    """Match tracks of the same class (Hungarian, BEV GIoU), intersect what matches, add the rest.

    Position is not compared by its covariance: a track that has just begun knows nothing of its velocity, and would be
    like everything around it as soon as it is predicted.

    Args:
        held: N tracks; they keep their ids and their order.
        heard: M tracks of another agent, in the same frame at the same time.
        gate: smallest BEV GIoU of two tracks of one object, in [-1, 1].

    Returns:
        The fused tracks, (N + new,), and in which of their rows each heard track is, (M,).
    """
    own, other = held.tracks, heard.tracks
    mine, theirs = match_boxes(own.boxes, own.label, other.boxes, other.label, gate)
    new = np.setdiff1d(np.arange(len(heard)), theirs)
    where = np.empty(len(heard), dtype=np.int64)
    where[theirs], where[new] = mine, len(held) + np.arange(len(new))
    fused = TrackEstimates.concatenate([held, _intersected(held[mine], heard[theirs]), heard[new]])
    order = np.arange(len(held))
    order[mine] = len(held) + np.arange(len(mine))
    rest = len(held) + len(mine) + np.arange(len(new))
    return fused[np.concatenate([order, rest])], where


def _intersected(first: TrackEstimates, second: TrackEstimates) -> TrackEstimates:
    """One estimate of each pair: planar states by covariance intersection, height and size by the same weight.

    The heading goes along the axis of the first's box, whose front stays in front: a mean would turn around where the
    two confuse front and back. The score is the better one.
    """
    mean, covariance, weight = covariance_intersection(first.mean, first.covariance, second.mean, second.covariance)
    a, b = first.tracks.boxes, second.tracks.boxes
    share = weight[:, None]
    turn = (b.yaw - a.yaw + np.pi / 2) % np.pi - np.pi / 2
    boxes = Boxes3D(
        share * a.center + (1 - share) * b.center,
        share * a.size + (1 - share) * b.size,
        wrap_angle(a.yaw + (1 - weight) * turn),
    )
    score = np.maximum(first.tracks.score, second.tracks.score)
    tracks = Tracks(first.tracks.id, boxes, first.tracks.velocity, score, first.tracks.label)
    return TrackEstimates(tracks, covariance).believing(mean, covariance)
