"""Communication: content of agents becomes messages (uplinks), bytes (codecs) and deliveries (channel, radio).

Input is each agent's `Observation`; output is the inbox of each agent, after loss, delay and bandwidth. Start with
`uplinks/uplink.py` for the content of messages, `codecs/codec.py` for their bytes, `channel/channel.py` for their way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from coopsim.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from coopsim.comms.codecs.codec import Codec as Codec
    from coopsim.comms.envelope import decode_detections as decode_detections
    from coopsim.comms.envelope import decode_features as decode_features
    from coopsim.comms.envelope import decode_points as decode_points
    from coopsim.comms.envelope import decode_tracks as decode_tracks
    from coopsim.comms.received_intents import ReceivedIntents as ReceivedIntents
    from coopsim.comms.received_lights import ReceivedLights as ReceivedLights
    from coopsim.comms.uplinks.once_per_frame import EncodeOnce as EncodeOnce
    from coopsim.comms.uplinks.share_detections import ShareDetections as ShareDetections
    from coopsim.comms.uplinks.share_features import ShareFeatures as ShareFeatures
    from coopsim.comms.uplinks.share_points import SharePoints as SharePoints
    from coopsim.comms.uplinks.share_tracks import ShareTracks as ShareTracks
    from coopsim.comms.uplinks.uplink import ContentUplink as ContentUplink
    from coopsim.comms.uplinks.uplink import Uplink as Uplink

_HOMES = {
    "Codec": "coopsim.comms.codecs.codec",
    "ContentUplink": "coopsim.comms.uplinks.uplink",
    "ReceivedIntents": "coopsim.comms.received_intents",
    "ReceivedLights": "coopsim.comms.received_lights",
    "EncodeOnce": "coopsim.comms.uplinks.once_per_frame",
    "ShareDetections": "coopsim.comms.uplinks.share_detections",
    "ShareFeatures": "coopsim.comms.uplinks.share_features",
    "SharePoints": "coopsim.comms.uplinks.share_points",
    "ShareTracks": "coopsim.comms.uplinks.share_tracks",
    "Uplink": "coopsim.comms.uplinks.uplink",
    "decode_detections": "coopsim.comms.envelope",
    "decode_features": "coopsim.comms.envelope",
    "decode_points": "coopsim.comms.envelope",
    "decode_tracks": "coopsim.comms.envelope",
}

__all__ = list(_HOMES)

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
