"""The uplink `detections`: each agent shares its own detections, with embeddings of the policy's own if it has any."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.comms.uplinks.once_per_frame import same
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.support.checks import require_flag
from coopsim.tracking.ab3dmot_tracker import OnBoardTracker
from coopsim.types import AgentSpec, Detections, Observation

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder


@UPLINKS.register("detections")
class ShareDetections(ContentUplink[Any]):
    """The agent's detections in its base frame, with its estimate of its pose.

    Detections that the codec cannot carry within its error bounds are left out.

    Args:
        codec: the spec of a codec for detections, or one as an object.
        velocities: send each box with the velocity of its track, by an on-board tracker of the sender. Receivers move
            late boxes by it.
    """

    content = "detections"

    def __init__(self, codec: str | Codec[Any] = "detections", velocities: bool = False) -> None:
        super().__init__(codec)
        require_flag(velocities=velocities)
        self._codec, self._velocities = cast(SharesDetections[Any], self.codec), velocities
        self._trackers: dict[str, OnBoardTracker] = {}

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        if self._velocities:
            self._trackers[spec.name] = OnBoardTracker()

    def content_of(self, sender: str, observation: Observation) -> Any:
        found = observation.detections
        if not (sent := self._codec.sendable(found)).all():
            found = found[sent]
        if self._velocities and found.velocity is None:
            found = self._trackers[sender].with_velocities(observation, found)
        return self._codec.content_of(found, sender, observation.time_ns, observation.pose)


class EmbedOnce:
    """Embedding of agents' own detections once a frame, for their uplinks and for their policy.

    Detections that have embeddings already keep them; without LiDARs and cameras there are none.
    """

    def __init__(self, embedder: Embedder) -> None:
        self._embedder = embedder
        self._latest: dict[str, tuple[Observation, Detections]] = {}

    def __call__(self, observation: Observation, spec: AgentSpec) -> Detections:
        """Return the agent's detections with embeddings, where they can have any."""
        found = observation.detections
        if found.embedding is not None or not len(found) or not (observation.sweeps or observation.cameras):
            return found
        known = self._latest.get(spec.name)
        if known is None or not _is_of(known[0], observation):
            known = self._latest[spec.name] = observation, self._embedder.apply(found, observation.view(spec))
        return known[1]


class ShareEmbedded(ShareDetections):
    """Detections of one agent with embeddings, as far as the codec carries them."""

    def __init__(
        self, embed: EmbedOnce, spec: AgentSpec, codec: str | Codec[Any] = "detections", velocities: bool = False
    ) -> None:
        super().__init__(codec, velocities)
        self._embed, self._spec = embed, spec

    def content_of(self, sender: str, observation: Observation) -> Any:
        return super().content_of(sender, replace(observation, detections=self._embed(observation, self._spec)))


def _is_of(known: Observation, observation: Observation) -> bool:
    """Return whether two observations are of one frame of one agent."""
    return known.time_ns == observation.time_ns and all(
        same(getattr(known, name), getattr(observation, name)) for name in ("detections", "sweeps", "cameras")
    )
