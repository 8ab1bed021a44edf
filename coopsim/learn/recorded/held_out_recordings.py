"""A look at held-out recordings in the middle of a training of covariances: what is learned, and what it is for."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import nn

from coopsim.learn.recorded.filter_losses import tracked_errors
from coopsim.learn.recorded.recorded_frames import RecordedFrames, frames_of
from coopsim.learn.recorded.training_recordings import RecordedWorld
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.metrics.track_log import TrackLog
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import seconds_to_ns
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups


class HeldOutRecordings:
    """The whole of the recordings that a training holds out, read once.

    Args:
        world: the recordings.

    Raises:
        CoopsimError: as `RecordedWorld.folder`; a recording is missing or broken.
    """

    def __init__(self, world: RecordedWorld) -> None:
        folder = world.folder()
        self._recordings = [frames_of(folder.load(name, world.detections), world.dt_s) for name in world.held_out]

    def __call__(self, net: nn.Module) -> dict[str, float]:
        """Return values by name: both losses, the mean squared Mahalanobis distance, and AMOTA by both protocols."""
        assert isinstance(net, CovarianceNet)
        if not self._recordings:
            return {}
        with torch.no_grad():
            values = tracked_errors(net, self._recordings).summary()
        counted = summarize([_log_of(net, each) for each in self._recordings])
        scores = {"AMOTA": counted["AMOTA"], "AMOTA ignored": counted.ignoring_false_positives()["AMOTA"]}
        return {name: round(float(value), 4) for name, value in {**values, **scores}.items()}


def _log_of(net: CovarianceNet, recorded: RecordedFrames) -> TrackLog:
    """Return the log of AB3DMOT on a recording, the agents in turn, with the covariances of a network."""
    tracker, evaluator, variance, row = ab3dmot(motion=net.motion()), Evaluator(), net.variances(recorded.numbers), 0
    for frame, groups in enumerate(recorded.found):
        found = replace(groups.joined, covariance=diagonals(variance[row : row + len(groups.joined)]))
        row += len(found)
        tracks = tracker.step_in_turn(DetectionGroups(found, groups.starts), seconds_to_ns(frame * recorded.dt_s))
        evaluator.update(recorded.truth[frame], tracks)
    return evaluator.log
