"""Losses of a filter along tracks: distance of its boxes from the labels, and likelihood of its innovations.

The tracks are given: no gradient passes through the association.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.samples.windows import NONE, RecordedFrames, RecordedWindow, WindowTracks, track_frames
from coopsim.nn.covariance.box_filter import (
    BoxFilter,
    TensorBeliefs,
    axis_difference,
    innovation_of,
    squared_distance,
)
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.tracking.motion.constant_velocity import MEASURED
from coopsim.types import Ints

TRUNCATED = 10
"""Frames through which gradients pass, as in DMSTrack."""

_TINY = 1e-12  # m^2, so that the length of no difference has a gradient


@dataclass(frozen=True, slots=True, eq=False)
class TrackErrors:
    """Errors of the updates along tracks.

    Attributes:
        error: (E,) length of the difference of updated boxes to their labels, m and rad.
        distance: (U,) squared Mahalanobis distance of the innovations: 7 on average where the covariances are right.
        log_det: (U,) logarithm of the determinant of their covariances S.
    """

    error: Tensor
    distance: Tensor
    log_det: Tensor

    def losses(self) -> dict[str, Tensor]:
        """Return the means: "updated", the source's loss, and "innovation", the negative log likelihood."""
        likelihood = 0.5 * (self.distance + self.log_det + MEASURED * math.log(2 * math.pi))
        return {"updated": _mean(self.error), "innovation": _mean(likelihood)}

    def summary(self) -> dict[str, float]:
        """Return both losses, and "mahalanobis", the mean squared distance (0 without updates), rounded."""
        values = {**self.losses(), "mahalanobis": _mean(self.distance)}
        return {name: round(float(value), 4) for name, value in values.items()}


def window_errors(net: CovarianceNet, windows: Sequence[RecordedWindow]) -> TrackErrors:
    """Filter along the tracks of one or more windows with the covariances of a network, with gradients."""
    box_filter, found = net.box_filter(), []
    for dt_s in sorted({each.dt_s for each in windows}):
        alike = [each for each in windows if each.dt_s == dt_s]
        noise = [window_noise(net, each) for each in alike]
        found.append(errors_along([each.tracks for each in alike], noise, box_filter, dt_s))
    return TrackErrors(*(torch.cat([getattr(each, part.name) for each in found]) for part in fields(TrackErrors)))


def window_noise(net: CovarianceNet, window: RecordedWindow) -> Tensor:
    """Return the covariances (M, 7, 7) float64 of a window's detections, in the frame of its boxes."""
    given = [window.numbers] if window.patches is None else [window.numbers, window.patches]
    tensors = [torch.from_numpy(each).float().to(net.base.device) for each in given]
    variance = net(*tensors).double()
    if window.heading_rad is None:
        return torch.diag_embed(variance)
    return turned_noise(variance, torch.from_numpy(window.heading_rad).to(variance.device))


def turned_noise(variance: Tensor, heading_rad: Tensor) -> Tensor:
    """Return covariances (M, 7, 7) of variances (M, 7) that hold along axes turned by headings (M,)."""
    cos, sin = heading_rad.cos(), heading_rad.sin()
    along, across = variance[:, 0], variance[:, 1]
    noise = torch.diag_embed(variance)
    x = cos * cos * along + sin * sin * across
    y = sin * sin * along + cos * cos * across
    both = cos * sin * (along - across)
    corner = torch.stack([torch.stack([x, both], dim=1), torch.stack([both, y], dim=1)], dim=1)
    upper = torch.cat([corner, noise[:, :2, 2:]], dim=2)
    return torch.cat([upper, noise[:, 2:]], dim=1)


def recording_errors(net: CovarianceNet, recordings: Sequence[RecordedFrames]) -> TrackErrors:
    """Track recordings with the covariances of a network, and filter along the tracks."""
    tracked = [(each, track_frames(each, net.variances(each.numbers), net.motion())) for each in recordings]
    return window_errors(net, [RecordedWindow(each.numbers, tracks, each.dt_s) for each, tracks in tracked])


def errors_along(
    tracks: Sequence[WindowTracks], noise: Sequence[Tensor], box_filter: BoxFilter, dt_s: float
) -> TrackErrors:
    """Filter along the tracks of several windows, all at once, with covariances (M, 7, 7) of each one's detections."""
    device = noise[0].device
    boxes = torch.from_numpy(np.concatenate([each.boxes for each in tracks])).to(device)
    detection, truth = (torch.from_numpy(each).to(device) for each in joined(tracks))
    spread = torch.cat(list(noise))
    count = detection.shape[2]
    beliefs, born = _nothing(count, boxes), torch.zeros(count, dtype=torch.bool)
    errors, distances, log_dets = [], [], []
    for frame in range(len(detection)):
        beliefs = box_filter.predict(beliefs.detach() if frame % TRUNCATED == 0 else beliefs, dt_s)
        for row in detection[frame]:
            found = row.cpu() != NONE
            old, new = ((found & each).nonzero()[:, 0].to(device) for each in (born, ~born))
            if len(old):
                known, at = beliefs.at(old), row[old]
                innovation = innovation_of(known, boxes[at])
                updated, factor = box_filter.update(known, innovation, spread[at])
                beliefs = beliefs.put(old, updated)
                distances.append(squared_distance(innovation, factor))
                log_dets.append(2 * torch.diagonal(factor, dim1=1, dim2=2).log().sum(dim=1))
            if len(new):
                beliefs = beliefs.put(new, box_filter.initiate(boxes[row[new]], spread[row[new]]))
            born = born | found
        labelled = torch.isfinite(truth[frame, :, 0]).nonzero()[:, 0]
        difference = axis_difference(beliefs.mean[labelled, :MEASURED], truth[frame, labelled])
        errors.append((difference.square().sum(dim=1) + _TINY).sqrt())
    none = [spread.new_zeros(0)]
    return TrackErrors(torch.cat(errors or none), torch.cat(distances or none), torch.cat(log_dets or none))


def joined(tracks: Sequence[WindowTracks]) -> tuple[Ints, Floats]:
    """Return `detection` and `truth` of several windows side by side, with numbers among all their detections.

    A window of fewer frames or agents than others has none in those that it lacks.
    """
    frames, agents = (max(each.detection.shape[axis] for each in tracks) for axis in (0, 1))
    detections, truths, before = [], [], 0
    for each in tracks:
        t, a, k = each.detection.shape
        detection, truth = np.full((frames, agents, k), NONE), np.full((frames, k, MEASURED), np.nan)
        detection[:t, :a] = np.where(each.detection == NONE, NONE, each.detection + before)
        truth[:t] = each.truth
        detections.append(detection)
        truths.append(truth)
        before += len(each.boxes)
    return np.concatenate(detections, axis=2), np.concatenate(truths, axis=1)


def _nothing(count: int, like: Tensor) -> TensorBeliefs:
    """Return beliefs without meaning about objects that are not seen yet."""
    none = like.new_zeros(count, 10)
    return TensorBeliefs(none, torch.diag_embed(none + 1))


def _mean(values: Tensor) -> Tensor:
    return values.sum() / max(len(values), 1)
