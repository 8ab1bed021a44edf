"""Detections with an appearance that the policy's own embedder gives them before they are shared."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.uplinks.once_per_frame import same
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.types import AgentSpec, Detections, Observation

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder


class EmbedOnce:
    """Embeds an agent's own detections once a frame, for its uplink and for its policy.

    Detections that have embeddings already keep them; without LiDARs and cameras there are none.

    Args:
        embedder: whose vectors they get.
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
    """The agent's detections with embeddings, as far as the codec carries them. Further arguments: `ShareDetections`.

    Args:
        embed: shared with the policy.
        spec: of the agent, the only one that this object serves.
    """

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
