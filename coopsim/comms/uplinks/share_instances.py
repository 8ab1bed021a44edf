"""The instances that a policy's network keeps of what an agent sees, for the uplink `queries`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.uplinks.uplink import ContentUplink
from coopsim.types import InstanceQueries, Observation

InstancesOf = Callable[[Mapping[str, Observation]], Mapping[str, InstanceQueries]]
"""What agents know by themselves after a frame, in their base frames, by agent; asked once per agent and frame."""


class ShareInstances(ContentUplink[InstanceQueries]):
    """What an agent knows by itself. No message reaches these instances, so no agent receives an echo of its own.

    Args:
        instances: of all agents that send in a frame; shared with the policy.
        codec: the spec of a codec for queries.
    """

    content = "queries"

    def __init__(self, instances: InstancesOf, codec: str | Codec[InstanceQueries] = "queries") -> None:
        super().__init__(codec)
        self._instances = instances

    def content_of(self, sender: str, observation: Observation) -> InstanceQueries:
        return self._instances({sender: observation})[sender]

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, InstanceQueries]:
        return dict(self._instances(observations))
