"""The uplinks `features` and `queries`: each agent shares the results of an encoder of its sensor data.

The encoder is a function that comes from outside, a policy as a rule: nothing here needs torch. Maps may carry requests
as in Where2comm (Hu et al., NeurIPS 2022): each message says where its sender knows little, and in the next frame the
others send what they know there first (`coopsim.fusion.request_maps`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec, make_codec
from coopsim.comms.codecs.feature_codec import FeatureHead, FeaturesCodec, SparseFeaturesCodec, read_head
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.errors import CodecError, InvalidValueError
from coopsim.fusion.request_maps import Request, request_map, selection_weight
from coopsim.support.checks import require_count
from coopsim.types import NS_PER_S, AgentSpec, FeatureMap, InstanceQueries, Message, Observation, SensorView
from coopsim.types.valid_detections import FARTHEST_M

T = TypeVar("T")


class EncodedViews(ContentUplink[T]):
    """Uplink of an encoder's results on agents' `SensorView`s.

    Give an `EncodeOnce` to share its results with a policy; it encodes all senders that this object serves in one
    batch.
    """

    def __init__(self, encode: Callable[[SensorView], T], codec: str | Codec[T]) -> None:
        if not callable(encode):
            raise InvalidValueError(f"encode must be a function of a SensorView, got {encode!r}")
        super().__init__(codec)
        self._encode, self._specs = encode, dict[str, AgentSpec]()

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._specs[spec.name] = spec

    def content_of(self, sender: str, observation: Observation) -> T:
        return self._encode(observation.view(self._specs[sender]))

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, T]:
        if not isinstance(self._encode, EncodeOnce):
            return super().contents(observations)
        return self._encode.all([observation.view(self._specs[name]) for name, observation in observations.items()])


@UPLINKS.register("features")
class ShareFeatures(EncodedViews[FeatureMap]):
    """Feature maps in the sender's base frame, for intermediate fusion; see `EncodedViews`."""

    content = "features"

    def __init__(self, encode: Callable[[SensorView], FeatureMap], codec: str | Codec[FeatureMap] = "features") -> None:
        super().__init__(encode, codec)


@UPLINKS.register("queries")
class ShareQueries(EncodedViews[InstanceQueries]):
    """Instance queries in the sender's base frame, for query fusion; see `EncodedViews`."""

    content = "queries"

    def __init__(
        self, encode: Callable[[SensorView], InstanceQueries], codec: str | Codec[InstanceQueries] = "queries"
    ) -> None:
        super().__init__(encode, codec)


InstancesOf = Callable[[Mapping[str, Observation]], Mapping[str, InstanceQueries]]
"""What agents know by themselves after a frame, in their base frames, by agent; asked once per agent and frame."""


class ShareInstances(ContentUplink[InstanceQueries]):
    """Instances that each agent keeps by itself. No message reaches them, so no agent receives an echo of its own."""

    content = "queries"

    def __init__(self, instances: InstancesOf, codec: str | Codec[InstanceQueries] = "queries") -> None:
        super().__init__(codec)
        self._instances = instances

    def content_of(self, sender: str, observation: Observation) -> InstanceQueries:
        return self._instances({sender: observation})[sender]

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, InstanceQueries]:
        return dict(self._instances(observations))


_VALID_NS = NS_PER_S
"""A request is kept for this long after its capture."""

_MOST_REQUESTS = 32


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    message: Message
    head: FeatureHead


class ShareMaps(ShareFeatures):
    """Maps of features in the world's axes around the sender, by its estimated heading.

    Under a budget, a codec that cannot leave anything out is replaced by the one of the spec `thrifty`; None: the
    budget is refused. `request_block` is the edge, in cells, of the blocks by which the sender asks for features; 0: it
    does not ask.
    """

    def __init__(
        self, encode: EncodeOnce[Any], codec: str = "features", thrifty: str | None = None, request_block: int = 0
    ) -> None:
        require_count(0, 255, request_block=request_block)
        super().__init__(lambda view: encode(view).message, codec)
        self._encoded, self._thrifty, self._request_block = encode, thrifty, request_block
        self._asked: dict[str, dict[str, _Asked]] = {}

    def prepare_budget(self) -> None:
        if self._thrifty is not None and not self.codec.divisible:
            self.codec_name, self.codec = make_codec(self._thrifty, self.content)

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, FeatureMap]:
        encoded = self._encoded.all([each.view(self._specs[name]) for name, each in observations.items()])
        return {name: self._asking(name, observations[name], each.message) for name, each in encoded.items()}

    def hear(self, receiver: str, observation: Observation) -> None:
        if not self._request_block:
            return
        known, oldest_ns = self._asked.get(receiver, {}), observation.time_ns - _VALID_NS
        for message in observation.inbox:
            before = known.get(message.sender)
            if before is None or message.captured_ns > before.message.captured_ns:
                head = _request(message, observation)
                if head is not None:
                    known[message.sender] = _Asked(message, head)
        recent = sorted(known.items(), key=lambda each: -each[1].message.captured_ns)[:_MOST_REQUESTS]
        self._asked[receiver] = {
            name: each for name, each in recent if oldest_ns <= each.message.captured_ns <= observation.time_ns
        }

    def _asking(self, sender: str, observation: Observation, content: FeatureMap) -> FeatureMap:
        """Return the content with the sender's request, and its cells in the order that others ask for."""
        if not self._request_block or content.confidence is None:
            return content
        requests = []
        for asked in self._asked.get(sender, {}).values():
            offset_m = observation.pose.xyz_yaw[:2] - asked.message.pose.xyz_yaw[:2]
            assert asked.head.request is not None
            grid = asked.head.grid.coarser(asked.head.shape[1] // len(asked.head.request))
            requests.append(Request(asked.head.request, grid, np.array([*offset_m, 0.0])))
        request, _ = request_map(content.confidence, content.grid, self._request_block)
        return replace(content, request=request, priority=selection_weight(content.confidence, content.grid, requests))


def _request(message: Message, observation: Observation) -> FeatureHead | None:
    """Return the head of a message with a request from within reach; None for any other message."""
    if message.codec not in CODECS or CODECS.get(message.codec) not in (FeaturesCodec, SparseFeaturesCodec):
        return None
    if not (np.abs(message.pose.xyz_yaw[:2] - observation.pose.xyz_yaw[:2]) <= FARTHEST_M).all():
        return None
    try:
        head = read_head(message.payload)
    except CodecError:
        return None
    return None if head.request is None else head
