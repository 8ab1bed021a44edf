"""Recordings as a filter reads them: all agents' detections, what a network is told of each, and the labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.data.recording_set import Recording
from coopsim.geometry.se3 import Floats
from coopsim.nn.covariance.box_numbers import NUMBERS, box_numbers
from coopsim.types import GroundTruth
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import drop_invalid


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """The T frames of a recording.

    Attributes:
        found: (T) the valid detections of all agents, the frame's owner first.
        truth: (T) the labels.
        numbers: (M, 19) of all detections, frame by frame and agent by agent, see `box_numbers`.
        dt_s: time between two frames.
    """

    found: tuple[DetectionGroups, ...]
    truth: tuple[GroundTruth, ...]
    numbers: Floats
    dt_s: float


def frames_of(recording: Recording, dt_s: float) -> RecordedFrames:
    """Return the frames of a recording."""
    agents = [[drop_invalid(each) for each in found] for found in recording.detections.values()]
    groups = tuple(DetectionGroups.of(each) for each in zip(*agents, strict=True))
    numbers = np.concatenate([np.zeros((0, NUMBERS)), *(_numbers(each) for each in groups)])
    return RecordedFrames(groups, tuple(recording.truth), numbers, dt_s)


def _numbers(groups: DetectionGroups) -> Floats:
    """Return the numbers (N, 19) of one frame: its owner is the origin, where the others were is not recorded."""
    sensors = np.full((len(groups), 4), np.nan)
    sensors[:1] = 0.0
    return box_numbers(groups.joined.boxes.array, groups.joined.score, groups.group, sensors)
