"""The uplink `tracks`: each agent shares its own tracks."""

from __future__ import annotations

from collections.abc import Callable

from coopsim.comms.codecs.track_codec import sendable
from coopsim.comms.uplinks.once_per_frame import StepOnce
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.tracking.ab3dmot_tracker import OnBoardTracker
from coopsim.types import Observation
from coopsim.types.track_estimates import TrackEstimates

TrackOwn = Callable[[str, Observation], TrackEstimates]
"""An agent's tracks of its own detections, in its base frame; asked once per agent and frame."""


@UPLINKS.register("tracks")
class ShareTracks(ContentUplink[TrackEstimates]):
    """Tracks of an agent's own detections in its base frame, with its estimate of its pose.

    No message reaches these tracks, so no agent receives an echo of its own. Without a function `track`, each agent has
    an `OnBoardTracker`.
    """

    content = "tracks"

    def __init__(self, track: TrackOwn | None = None) -> None:
        super().__init__("tracks")
        self._track = track or OwnTracks().in_base_frame

    def content_of(self, sender: str, observation: Observation) -> TrackEstimates:
        estimates = self._track(sender, observation)
        return estimates[sendable(estimates)]


class OwnTracks:
    """On-board trackers of many agents, stepped once per frame, whether uplink or policy asks first."""

    def __init__(self, make_tracker: Callable[[], OnBoardTracker] = OnBoardTracker) -> None:
        self._steps = StepOnce(make_tracker, OnBoardTracker.step)

    def begin_sending(self, agent: str) -> None:
        """Begin an episode of `agent`: call it when its uplink is made."""
        self._steps.begin_sending(agent)

    def begin(self, agent: str) -> None:
        """Begin an episode of `agent`, unless its uplink has done so: call it in `Policy.begin`."""
        self._steps.begin(agent)

    def in_odometry_frame(self, agent: str, observation: Observation) -> tuple[TrackEstimates, OnBoardTracker]:
        """Return the tracks of a frame in the agent's odometry frame, and its tracker."""
        estimates = self._steps(agent, observation)
        return estimates, self._steps.state(agent)

    def in_base_frame(self, agent: str, observation: Observation) -> TrackEstimates:
        """Return the tracks of a frame in the agent's base frame."""
        estimates, tracker = self.in_odometry_frame(agent, observation)
        return estimates.transform(tracker.frame.odom_SE3_base.inverse())
