"""Attacks by the number of messages, senders and objects: `sybil`, `flood` and `overload`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from coopsim.attacks.claims import Claims
from coopsim.comms.codecs.codec import decoder
from coopsim.comms.envelope import decode_detections, decode_tracks
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView
from coopsim.support.checks import require_count, require_number, require_probability
from coopsim.types import Detections, Message, PoseEstimate
from coopsim.types.messages import stranger
from coopsim.types.taxonomy import ObjectClass
from coopsim.types.track_estimates import TrackEstimates


@ATTACKS.register("sybil")
@dataclass(kw_only=True)
class Sybil(Attack):
    """Repeat the own message under made-up names, from made-up places: several voices say the same (F2MD's grid Sybil).

    Together with another attack, as in `["ghost", "sybil"]`, all of them tell its lie. Detections and tracks are moved
    to where the made-up senders claim to be; other contents are repeated from the agent's own place.

    Attributes:
        senders: number of made-up senders, each of which costs a message in each frame.
        apart_m: distance between them.
    """

    senders: int = 3
    apart_m: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, 100, senders=self.senders)
        require_number("in [0, 100]", lambda far: 0 <= far <= 100, apart_m=self.apart_m)

    def further(self, view: AttackerView, message: Message | None) -> Sequence[Message]:
        return () if message is None else [self._as(message, number) for number in range(self.senders)]

    def _as(self, message: Message, number: int) -> Message:
        """Return the message as that of a made-up sender, behind the agent."""
        base_SE3_other = SE3.from_xyz_yaw(np.array([-(number + 1) * self.apart_m, 0.0, 0.0]), 0.0)
        place = message.pose.world_SE3_base.compose(base_SE3_other)
        pose = PoseEstimate(np.append(place.translation, message.pose.xyz_yaw[3]), message.pose.covariance)
        moved = replace(message, sender=stranger(number), pose=pose)
        codec = decoder(message.codec)
        try:
            content = self._content(codec, message, moved, base_SE3_other.inverse())
        except CodecError:
            return replace(message, sender=stranger(number))
        return replace(moved, payload=codec.encode(content))

    def _content(self, codec: Any, message: Message, moved: Message, other_SE3_base: SE3) -> Any:
        if codec.content == "tracks":
            return decode_tracks(message).transform(other_SE3_base)
        found = decode_detections(message).transform(other_SE3_base)
        return codec.content_of(found[codec.sendable(found)], moved.sender, moved.captured_ns, moved.pose)


@ATTACKS.register("flood")
@dataclass(kw_only=True)
class Flood(Attack):
    """Send the own message again and again, each time with another stamp: F2MD's denial of service.

    On a channel with a bandwidth it delays everybody; receivers decode and track every copy. A radio holds 1000 of
    them, a receiver 4096 messages; more is dropped, and counted.

    Attributes:
        messages: number of further messages in each frame.
    """

    messages: int = 100

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, 10_000, messages=self.messages)

    def further(self, view: AttackerView, message: Message | None) -> Sequence[Message]:
        if message is None:
            return ()
        stamps_ns = (max(message.captured_ns - 1 - number, 0) for number in range(self.messages))
        return [replace(message, captured_ns=stamp_ns) for stamp_ns in stamps_ns]


@ATTACKS.register("overload")
@dataclass(kw_only=True)
class Overload(Attack):
    """Send very many weak objects, which multiply the time of fusion and tracking, after CP-FREEZER (2508.01062).

    Attributes:
        objects: number of objects in each message, of 30 bytes or so each.
        score: confidence of each.
        around_m: half the edge of the square around the agent in which they lie, drawn anew in each frame.
    """

    objects: int = 1000
    score: float = 0.3
    around_m: float = 50.0
    knowledge: ClassVar[str] = "none"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, 10_000, objects=self.objects)
        require_probability(score=self.score)
        require_number("in (0, 1000]", lambda far: 0 < far <= 1000, around_m=self.around_m)
        self._frame = 0

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        return self._claims(view).among_detections(detections, view.rng)

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        return self._claims(view).among_tracks(tracks, view.rng)

    def _claims(self, view: AttackerView) -> Claims:
        count = self.objects
        place = view.rng.uniform(-self.around_m, self.around_m, (count, 2))
        yaw = view.rng.uniform(-np.pi, np.pi, count)
        boxes = Boxes3D.from_array(np.column_stack([place, np.tile([0.9, 4.5, 1.9, 1.8], (count, 1)), yaw]))
        ids = np.arange(count) + self._frame * count
        self._frame += 1
        view.claim(ids, boxes)
        label = np.full(count, int(ObjectClass.CAR))
        return Claims(ids, boxes, np.zeros((count, 2)), np.full(count, self.score), label)
