"""The maps that a policy's network makes for others, for the uplink `features`; with requests, where the policy asks.

Requests are Where2comm's (Hu et al., NeurIPS 2022): each message says where its sender knows little, and in the next
frame the others send what they know there first (`coopsim.fusion.request_maps`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS, make_codec
from coopsim.comms.codecs.feature_codec import FeatureHead, FeaturesCodec, read_head
from coopsim.comms.codecs.sparse_feature_codec import SparseFeaturesCodec
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.share_features import ShareFeatures
from coopsim.errors import CodecError
from coopsim.fusion.request_maps import Request, request_map, selection_weight
from coopsim.support.checks import require_count
from coopsim.types import NS_PER_S, FeatureMap, Message, Observation
from coopsim.types.valid_detections import FARTHEST_M

_VALID_NS = NS_PER_S
"""A request is kept for this long after its capture."""

_MOST_REQUESTS = 32


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    message: Message
    head: FeatureHead


class ShareMaps(ShareFeatures):
    """Maps of features in the world's axes around the sender, by its estimated heading.

    Args:
        encode: makes something whose `message` is the map; shared with the policy.
        codec: the spec of a codec for features.
        thrifty: the spec of the codec that is taken under a budget, where the other cannot leave anything out; None:
            such a budget is refused.
        request_block: edge of the blocks of cells by which the sender asks for features, in cells; 0: it does not ask.
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
