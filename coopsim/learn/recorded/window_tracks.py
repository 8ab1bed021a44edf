"""The tracks in a recording: which detections each consists of, as the library's tracker decides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.assignment import Pairs, greedy, hungarian
from coopsim.geometry.box_similarity import center_distance_bev
from coopsim.geometry.se3 import Floats
from coopsim.learn.recorded.recorded_frames import RecordedFrames
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import MEASURED, ConstantVelocity
from coopsim.tracking.track_states import TrackStates
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, GroundTruth, Ints, seconds_to_ns
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups

GATE, AGE = -0.2, 2
"""Smallest 3D GIoU of a match, and frames without a detection until a track ends: AB3DMOT's."""

SAME_OBJECT_M = 4.0
"""Largest distance of a track and its label on the ground, as in DMSTrack."""

NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class WindowTracks:
    """The K tracks in T frames with A agents.

    Attributes:
        detection: (T, A, K) number of the agent's detection among the M of all frames; `NONE` without.
        truth: (T, K, 7) box of the label near a track that was detected in the frame; NaN without.
        boxes: (M, 7) the detections.
    """

    detection: Ints
    truth: Floats
    boxes: Floats

    def cut(self, first: int, frames: int) -> tuple[WindowTracks, Ints]:
        """Return some frames, with the tracks that are detected in them, and the numbers (m,) of their detections."""
        detection = self.detection[first : first + frames]
        seen = (detection != NONE).any(axis=(0, 1))
        detection, truth = detection[:, :, seen], self.truth[first : first + frames, seen]
        rows = np.unique(detection[detection != NONE])
        numbered = np.where(detection == NONE, NONE, np.searchsorted(rows, detection))
        return WindowTracks(numbered, truth, self.boxes[rows]), rows


class _Watched(Cascade):
    """An association that remembers its pairs: of each group, the ids of tracks and the rows of their detections."""

    def __init__(self, stages: Sequence[Stage]) -> None:
        super().__init__(stages)
        self.groups: list[tuple[Ints, Ints]] = []

    def match(self, tracks: TrackStates, detections: Detections) -> Pairs:
        rows, columns = super().match(tracks, detections)
        self.groups.append((tracks.id[rows], columns))
        return rows, columns


def track_frames(frames: RecordedFrames, variance: Floats, motion: ConstantVelocity) -> WindowTracks:
    """Track a recording with AB3DMOT's association and lifecycle, the agents in turn.

    Args:
        frames: of the recording.
        variance: (M, 7) of the detections.
        motion: the motion model.
    """
    watched = _Watched([Stage(giou_3d, hungarian, gate=GATE)])
    tracker = Tracker(motion, watched, HitsAndAge(age=AGE))
    taken: list[tuple[int, int, Ints, Ints]] = []  # frame, agent, ids of tracks, rows of detections
    true: list[tuple[int, Ints, Floats]] = []  # frame, ids of tracks, boxes
    row, tracks = 0, 0
    for frame, groups in enumerate(frames.found):
        sizes = np.diff(groups.starts)
        spread = replace(groups.joined, covariance=diagonals(variance[row : row + len(groups.joined)]))
        watched.groups.clear()
        tracker.step_in_turn(DetectionGroups(spread, groups.starts), seconds_to_ns(frame * frames.dt_s))
        for agent, (known, columns) in zip(np.flatnonzero(sizes), watched.groups, strict=True):
            new = np.setdiff1d(np.arange(sizes[agent]), columns)
            ids = np.concatenate([known - 1, tracks + np.arange(len(new))])
            rows = row + groups.starts[agent] + np.concatenate([columns, new])
            taken.append((frame, int(agent), ids, rows))
            tracks += len(new)
        row += len(groups.joined)
        true.append((frame, *_labels_near(tracker.state.tracked, frames.truth[frame])))
    return _as_arrays(frames, tracks, taken, true)


def _labels_near(tracked: TrackStates, truth: GroundTruth) -> tuple[Ints, Floats]:
    """Return the numbers (K,) of the tracks that were detected now and are near a label, and its box (K, 7)."""
    detected = np.flatnonzero(tracked.misses == 0)
    near = center_distance_bev(tracked.boxes[detected], truth.boxes.array)
    rows, columns = greedy(near, -SAME_OBJECT_M)
    return tracked.id[detected[rows]] - 1, truth.boxes.array[columns]


def _as_arrays(
    recorded: RecordedFrames,
    tracks: int,
    taken: Sequence[tuple[int, int, Ints, Ints]],
    true: Sequence[tuple[int, Ints, Floats]],
) -> WindowTracks:
    frames, agents = len(recorded.found), max((len(groups) for groups in recorded.found), default=0)
    detection = np.full((frames, agents, tracks), NONE)
    truth = np.full((frames, tracks, MEASURED), np.nan)
    for frame, agent, ids, rows in taken:
        detection[frame, agent, ids] = rows
    for frame, ids, boxes in true:
        truth[frame, ids] = boxes
    boxes = np.concatenate([np.zeros((0, MEASURED)), *(groups.joined.boxes.array for groups in recorded.found)])
    return WindowTracks(detection, truth, boxes)
