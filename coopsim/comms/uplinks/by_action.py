"""The uplink `action`: an agent's action says what it sends, see `docs/learn/messages_as_actions.md`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.comms.envelope import encode_message
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import UPLINKS, Uplink
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError, InvalidActionError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_flag, require_positive, require_probability
from coopsim.types import Detections, Ints, Mask, Message, Observation
from coopsim.types.messages import MessagePart, Said

FORMS = ("scores", "cells", "payload")


@UPLINKS.register("action")
class SaidByAction(Uplink):
    """Messages that the agents' actions say; without an action it is silent.

    A message is captured when its observation is, and sent then. It arrives with the next frame, or later.

    Args:
        form: "scores": one for each detection, in the observation's order; "cells": a square map of scores around the
            agent, heading up, of which a detection has that of its cell; "payload": bytes that the codec decodes.
        threshold: detections are sent if their score is above it, the highest first.
        rows: number of scores; detections after so many have none, and are not sent.
        cells: number of cells along each side of the map.
        metres: length of the map's side; detections outside are not sent.
        to: an action says whom the message is for; without, it is for all.
        ask: an action says whose next messages the agent wants; a message goes to those alone that asked in the step
            before. Requests take no time and no bytes.
        codec: the spec of the codec, for scores and cells one for detections.

    Raises:
        InvalidValueError, UnknownNameError: a value is not accepted.
    """

    budget_bytes: int | None = None
    """Largest size of a message, envelope included; the environment sets it."""

    def __init__(
        self,
        form: Literal["scores", "cells", "payload"] = "scores",
        threshold: float = 0.0,
        rows: int = 64,
        cells: int = 16,
        metres: float = 96.0,
        to: bool = False,
        ask: bool = False,
        codec: str = "detections",
    ) -> None:
        require_choice("form", form, FORMS)
        require_probability(threshold=threshold)
        require_count(1, rows=rows, cells=cells)
        require_positive(metres=metres)
        require_flag(to=to, ask=ask)
        self._form, self._threshold, self._metres = form, threshold, metres
        size = {"scores": rows, "cells": cells, "payload": 0}[form]
        self.part = MessagePart(form, size, metres, codec, to=to, ask=ask)
        if form == "payload":
            self.codec_name, parameters = parse_spec("codec", codec)
            self.codec: Codec[Any] = instantiate("codec", self.codec_name, CODECS.get(self.codec_name), parameters)
        else:
            self._share = ShareDetections(codec)
            self.codec_name, self.codec = self._share.codec_name, self._share.codec
        self.content = self.codec.content  # type: ignore[misc]  # of the class elsewhere

    def message(self, sender: str, observation: Observation) -> None:
        return None

    def said(self, sender: str, observation: Observation, said: Said) -> Message | None:
        """Return the message that an action says; None: nothing is sent.

        Raises:
            InvalidActionError: the payload is none of the codec's, or over the budget.
        """
        if said.payload is not None:
            return self._of_payload(sender, observation, said.payload)
        if said.score is None:
            return None
        chosen = self._chosen(said.score, observation.detections)
        return self._of_detections(sender, observation, chosen) if len(chosen) else None

    def _chosen(self, score: Floats, found: Detections) -> Detections:
        """Return the detections with a score above the threshold, the highest first."""
        score = self._in_cells(score, found) if self._form == "cells" else score[: len(found)]
        order: Ints = np.argsort(-score, kind="stable")
        chosen = found[order[score[order] > self._threshold]]
        return chosen[cast(SharesDetections[Any], self._share.codec).sendable(chosen)]

    def _in_cells(self, score: Floats, found: Detections) -> Floats:
        """Return the score (N,) of each detection's cell; 0 outside the map."""
        along = (self._metres / 2 - found.boxes.center[:, :2]) * (len(score) / self._metres)
        inside: Mask = np.asarray(((along >= 0) & (along < len(score))).all(axis=1))
        row, column = np.where(inside[:, None], along, 0).astype(np.int64).T
        scores: Floats = np.where(inside, score[row, column], 0.0)
        return scores

    def _of_detections(self, sender: str, observation: Observation, chosen: Detections) -> Message | None:
        """Return a message with as many of the first detections as the budget holds; None if it holds none."""
        share = self._share
        content = share.content_of(sender, replace(observation, detections=chosen))
        message = share.message_with(sender, observation, share.encode_content(sender, content))
        size_bytes = len(encode_message(message))
        if self.budget_bytes is None or size_bytes <= self.budget_bytes:
            return message
        left_bytes = self.budget_bytes - (size_bytes - len(message.payload))
        payload = share.codec.encode_within(content, left_bytes)
        none = share.codec.encode_within(content, 0)
        return replace(message, payload=payload) if len(none) < len(payload) <= left_bytes else None

    def _of_payload(self, sender: str, observation: Observation, payload: bytes) -> Message:
        message = Message(sender, observation.time_ns, observation.pose, payload, self.codec_name)
        size_bytes = len(encode_message(message))
        if self.budget_bytes is not None and size_bytes > self.budget_bytes:
            raise InvalidActionError(
                f"{sender}: message must have at most {self.budget_bytes} bytes, envelope included, got {size_bytes}"
            )
        try:
            self.codec.decode(payload)
        except CodecError as error:
            raise InvalidActionError(
                f"{sender}: message payload must be one of codec {self.codec_name!r}: {error}"
            ) from error
        return message
