"""Windows of simulated clips: what a network detects in all agents' points, and what its maps show around each box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.recorded.recorded_frames import RecordedFrames
from coopsim.learn.recorded.recorded_windows import RecordedWindow
from coopsim.learn.recorded.window_tracks import track_frames
from coopsim.learn.samples.sample_frames import sweeps_of
from coopsim.nn.covariance.box_numbers import NUMBERS, own_numbers
from coopsim.nn.inference.cloud_detector import CloudDetector
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.types import Detections, GroundTruth
from coopsim.types.groups import DetectionGroups

REACH_M, LEAST_SCORE = 76.8, 0.1
"""Half the edge of the square in which an agent looks for objects, and the smallest score: the detector's defaults."""


def detected_window(clip: Clip, detector: CloudDetector) -> RecordedWindow:
    """Return a clip as a filter sees it: boxes in the world's frame, the rest as the detecting agent has it.

    Tracks are AB3DMOT's, with its own noise, the agents in turn: the association does not depend on what is learned.
    The agents' poses are the true ones.

    Args:
        clip: the scenes, in order.
        detector: of all agents.
    """
    found: list[DetectionGroups] = []
    numbers, patches, heading_rad = [np.zeros((0, NUMBERS))], [], []
    for number, scene in enumerate(clip.scenes):
        groups = []
        for member, agent in enumerate(scene.agents):
            points = sweeps_of(clip, number, member, detector.sweeps)
            seen, looks = detector.detect_patches(points, REACH_M, LEAST_SCORE)
            groups.append(Detections(seen.boxes, seen.score, seen.label).transform(_world_SE3_base(agent)))
            numbers.append(own_numbers(seen.boxes.array, seen.score))
            patches.append(looks)
            heading_rad.append(np.full(len(seen), agent.xyz_yaw[3]))
        found.append(DetectionGroups.of(groups))
    frames = RecordedFrames(tuple(found), _truth(clip.scenes), np.concatenate(numbers), clip.dt_s)
    tracks = track_frames(frames, np.ones((len(frames.numbers), 7)), ConstantVelocity())
    return RecordedWindow(frames.numbers, tracks, clip.dt_s, np.concatenate(heading_rad), np.concatenate(patches))


def _world_SE3_base(agent: AgentScene) -> SE3:
    return SE3.from_xyz_yaw(agent.xyz_yaw[:3], agent.xyz_yaw[3])


def _truth(scenes: Sequence[Scene]) -> tuple[GroundTruth, ...]:
    """Return the objects of each scene that a LiDAR hits."""
    shown: list[tuple[Scene, Floats]] = [(scene, scene.returns.max(axis=1) > 0) for scene in scenes]
    return tuple(
        GroundTruth(scene.object_id[seen], Boxes3D.from_array(scene.boxes[seen]), scene.label[seen])
        for scene, seen in shown
    )
