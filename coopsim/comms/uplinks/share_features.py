"""The uplinks `features` and `queries`: each agent shares what an encoder makes of its sensor data.

The encoder is a function that comes from outside, a policy as a rule: nothing here needs torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.errors import InvalidValueError
from coopsim.types import AgentSpec, FeatureMap, InstanceQueries, Observation, SensorView

T = TypeVar("T")


class EncodedViews(ContentUplink[T]):
    """An uplink of what an encoder makes of an agent's `SensorView`.

    Args:
        encode: the encoder. Give an `EncodeOnce` to share its results with a policy; it encodes all senders that this
            object serves in one batch.
        codec: the spec of a codec for the content, or one as an object.
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
