"""An uplink that keeps its messages within a number of bytes."""

from __future__ import annotations

from dataclasses import replace

from coopsim.comms.envelope import encode_message
from coopsim.comms.uplinks.selection import Selection
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count
from coopsim.types import Message, Observation


class WithinBudget(Uplink):
    """Another uplink's messages, of as many objects as fit, the most useful first.

    How many bytes an object takes is the codec's business: the largest number of objects is found by trying, with
    about log2 N messages of which one is sent.

    Args:
        uplink: whose messages are kept within the budget; one without a memory, as `ShareDetections`.
        budget_bytes: largest size of a message on the air, envelope included. A message without objects is sent even
            if that alone is larger: it says where the agent is.
        selection: which objects come first.
    """

    def __init__(self, uplink: Uplink, budget_bytes: int, selection: Selection) -> None:
        require_count(1, budget_bytes=budget_bytes)
        if not uplink.repeatable:
            raise InvalidValueError(
                f"budget_bytes is for uplinks that share what was detected in a frame, not for {type(uplink).__name__}"
            )
        self._uplink, self._budget_bytes, self._selection = uplink, budget_bytes, selection

    def message(self, sender: str, observation: Observation) -> Message | None:
        message = self._fitting(sender, observation)
        if message is not None:
            self._selection.sent(message)
        return message

    def hear(self, observation: Observation) -> None:
        self._selection.hear(observation)

    def _fitting(self, sender: str, observation: Observation) -> Message | None:
        whole = self._uplink.message(sender, observation)
        if whole is None or len(encode_message(whole)) <= self._budget_bytes:
            return whole
        ranked = observation.detections[self._selection.order(sender, observation)]
        fits = self._uplink.message(sender, replace(observation, detections=ranked[:0]))
        least, most = 1, len(ranked) - 1
        while least <= most:
            count = (least + most) // 2
            tried = self._uplink.message(sender, replace(observation, detections=ranked[:count]))
            if tried is not None and len(encode_message(tried)) <= self._budget_bytes:
                fits, least = tried, count + 1
            else:
                most = count - 1
        return fits
