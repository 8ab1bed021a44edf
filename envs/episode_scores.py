"""The scores of an episode: logs of tracks, drives, trust and lies, frame by frame, and what they come to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from coopsim.envs.frames import Frame, FrameSource
from coopsim.envs.options import CommonOptions
from coopsim.envs.scorer import Scorer
from coopsim.errors import EpisodeStateError
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.metrics.deception_log import DeceptionLog
from coopsim.metrics.drive_log import DriveFrame, DriveLog
from coopsim.metrics.evaluator import FrameCounts
from coopsim.metrics.score import Score, summarize
from coopsim.metrics.track_log import TrackLog
from coopsim.metrics.trust_log import TrustLog
from coopsim.types import Tracks, stack_xyz_yaw
from coopsim.types.lies import Lie, lying_senders


class EpisodeScores:
    """Logs of an episode, by agent.

    Args:
        source: source of the frames.
        options: the environment's options.
        frame: first frame of the episode.
    """

    def __init__(self, source: FrameSource, options: CommonOptions, frame: Frame) -> None:
        self._false_positives, self._region_m = options.false_positives, source.region_m
        # Of a recording, an episode need not have all possible agents.
        self._scorer = Scorer(tuple(frame.agents), options.match_iou, source.region_m)
        self._drives = _DriveRecorder(frame, source.conflicts)
        self._trusts: dict[str, TrustLog] = {}
        liars = attacks_by_agent(options.attacks)
        # Of the agents that are lied to: of all honest ones, where there is any attack.
        self._deceptions = {name: DeceptionLog() for name in frame.agents if liars and name not in liars}

    @property
    def logs(self) -> dict[str, TrackLog]:
        """Reported tracks and ground truth, by agent."""
        return {name: evaluator.log for name, evaluator in self._scorer.evaluators.items()}

    @property
    def drives(self) -> dict[str, DriveLog]:
        """Logs of the drives, by driven agent."""
        return self._drives.logs

    def update(self, frame: Frame, tracks: Mapping[str, Tracks], lies: Sequence[Lie]) -> dict[str, FrameCounts]:
        """Log the tracks that agents report for a frame, each in the agent's base frame, beside the frame's lies."""
        region = None if self._region_m is None or not self._deceptions else np.array(self._region_m)
        for name, log in self._deceptions.items():
            if name in frame.agents:
                agent = frame.agents[name]
                log.append(lies, agent.body.world_SE3_base, agent.truth, tracks[name], region)
        return self._scorer.update(frame.agents, tracks)

    def note_drives(self, frame: Frame, tracks: Mapping[str, Tracks], after: Frame) -> None:
        """Log how cars drove from a frame, with the tracks reported for it, to the frame `after` it."""
        self._drives.update(frame, tracks, after)

    def note_trust(self, agent: str, trust: Mapping[str, float], lies: Sequence[Lie], passes: int) -> None:
        """Log an agent's trust in its senders in a frame with these lies; see `CooperativeEnv.note_trust`."""
        self._trusts.setdefault(agent, TrustLog()).append(trust, lying_senders(lies), passes)

    def score(self, bytes_per_s: Callable[[str], float]) -> Score:
        """Return the episode's score so far, given a function of an agent to the bytes that it sends in a second.

        Raises:
            EpisodeStateError: nothing has been scored yet.
        """
        logs = self.logs
        if not any(len(log) for log in logs.values()):
            raise EpisodeStateError("nothing has been scored yet: call reset, then step")
        return Score.mean(
            {
                name: summarize(
                    [log],
                    false_positives=self._false_positives,
                    bytes_per_s=bytes_per_s(name),
                    drives=[self.drives[name]] if name in self.drives else [],
                    trusts=[self._trusts[name]] if name in self._trusts else [],
                    deceptions=[self._deceptions[name]] if name in self._deceptions else [],
                )
                for name, log in logs.items()
            }
        )


class _DriveRecorder:
    """Logs of the drives of an episode, by driven agent; `conflicts` are ids of actors, see `FrameSource.conflicts`."""

    def __init__(self, frame: Frame, conflicts: tuple[int, ...]) -> None:
        self.logs = {name: DriveLog() for name, agent in frame.agents.items() if agent.car is not None}
        self._conflicts = conflicts

    def update(self, frame: Frame, tracks: Mapping[str, Tracks], after: Frame) -> None:
        """Log a frame with the tracks reported for it; also the frame `after` it if that is the last."""
        self._append(frame, tracks, {name: agent.command_m_s2 for name, agent in after.agents.items()})
        if after.last:
            self._append(after, {}, {})

    def _append(self, frame: Frame, tracks: Mapping[str, Tracks], commands: Mapping[str, float]) -> None:
        for name, log in self.logs.items():
            agent, reported = frame.agents[name], tracks.get(name, Tracks.empty())
            assert agent.car is not None
            pose, command = stack_xyz_yaw(agent.body.world_SE3_base)[[0, 1, 3]], commands.get(name, math.nan)
            log.append(DriveFrame(frame.time_ns, pose, agent.car, agent.truth, reported, command, self._conflicts))
