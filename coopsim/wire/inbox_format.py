"""The format of inboxes: messages to arrays and back, for all receivers of a frame together.

The receivers of a frame hear nearly the same messages. Each message is written once as a row of its numbers, and read
once as an object that all its receivers share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers, frozen
from coopsim.types import Message, PoseEstimate
from coopsim.types.messages import stranger, stranger_number

_NUMBERS = ("sender", "codec", "captured_ns", "payload_bytes")


_NOTHING: Mapping[str, NDArray[Any]] = {
    **{name: np.zeros(0, np.int64) for name in ("sender", "codec", "captured_ns")},
    "pose": np.zeros((0, 4)),
    "payload_bytes": np.zeros(0, np.int64),
}
_NO_COVARIANCES: Mapping[str, NDArray[Any]] = {"pose_covariance": np.zeros((0, 3, 3))}
"""Columns of no messages."""


class InboxPacker:
    """Packer of the inboxes of one frame.

    Senders are numbered in the order of `agents`, strangers after them. `messages` are those of all inboxes, in any
    order, equal objects once or several times. With `covariances`, poses have them; zeros stand for none.
    """

    def __init__(self, agents: Sequence[str], messages: Sequence[Message], *, covariances: bool) -> None:
        self._columns: dict[str, NDArray[Any]] = {**_NOTHING, **(_NO_COVARIANCES if covariances else {})}
        if not messages:
            return
        distinct = list({id(message): message for message in messages}.values())
        number = {name: row for row, name in enumerate(agents)}
        for name in {message.sender for message in distinct} - number.keys():
            number[name] = _number_of_stranger(name, len(agents))
        codec = {name: row for row, name in enumerate(CODECS.names())}
        self._kept = distinct  # an id is a message's own only while the message lives
        self._row = {id(message): row for row, message in enumerate(distinct)}
        self._columns = {
            "sender": np.array([number[message.sender] for message in distinct], dtype=np.int64),
            "codec": np.array([codec[message.codec] for message in distinct], dtype=np.int64),
            "captured_ns": np.array([message.captured_ns for message in distinct], dtype=np.int64),
            "pose": np.array([message.pose.xyz_yaw for message in distinct]).reshape(-1, 4),
            "payload_bytes": np.array([len(message.payload) for message in distinct], dtype=np.int64),
        }
        if covariances:
            self._columns["pose_covariance"] = pack_covariances([message.pose for message in distinct])

    def pack(self, inbox: Sequence[Message]) -> dict[str, Any]:
        """Return the entries of one receiver's observation: its messages' numbers, and their payloads end to end."""
        if not inbox:
            heads = {name: column[:0].copy() for name, column in self._columns.items()}
            return {"inbox": heads, "inbox_payload": np.zeros((0, 1), np.uint8)}
        rows = np.array([self._row[id(message)] for message in inbox], dtype=np.int64)
        heads = {name: column[rows] for name, column in self._columns.items()}
        payload = np.frombuffer(b"".join([message.payload for message in inbox]), dtype=np.uint8)
        return {"inbox": heads, "inbox_payload": payload[:, None]}


class InboxReader:
    """Reader of packed inboxes; receivers of the same bytes get the same `Message` objects.

    Every byte of every inbox is looked at: the content of one receiver's inbox is never taken for another's. Senders
    are numbered in the order of `agents`, strangers after them.
    """

    def __init__(self, agents: Sequence[str]) -> None:
        self._agents, self._codecs = agents, CODECS.names()
        self._known: dict[tuple[int, int, int], tuple[bytes, bytes, bytes, Message]] = {}

    def read(self, packed: Mapping[str, Any]) -> tuple[Message, ...]:
        """Return the messages in one packed observation."""
        heads = packed["inbox"]
        count = len(heads["sender"])
        if not count:
            return ()
        payload = np.asarray(packed["inbox_payload"], dtype=np.uint8).tobytes()
        # Copies, because several receivers share what is made of one receiver's arrays.
        poses = frozen(heads["pose"], (count, 4), np.float64, "inbox pose").copy()
        spreads = np.zeros((count, 0))
        if "pose_covariance" in heads:
            spreads = frozen(heads["pose_covariance"], (count, 3, 3), np.float64, "inbox pose_covariance").copy()
        numbers = [as_numbers(heads[name], np.int64, f"inbox {name}", whole_floats=True).tolist() for name in _NUMBERS]
        pose_bytes, spread_bytes = poses.tobytes(), spreads.tobytes()
        width = len(spread_bytes) // count
        messages, begin = [], 0
        for row, (sender, codec, captured_ns, length) in enumerate(zip(*numbers, strict=True)):
            content = payload[begin : begin + length]
            pose, spread = pose_bytes[row * 32 : (row + 1) * 32], spread_bytes[row * width : (row + 1) * width]
            known = self._known.get((sender, codec, captured_ns))
            if known is None or known[0] != content or known[1] != pose or known[2] != spread:
                estimate = PoseEstimate(poses[row], stated_covariance(spreads[row]))
                message = Message(self._name(sender), captured_ns, estimate, content, self._codecs[codec])
                known = self._known[sender, codec, captured_ns] = content, pose, spread, message
            messages.append(known[3])
            begin += length
        return tuple(messages)

    def _name(self, number: int) -> str:
        return self._agents[number] if number < len(self._agents) else stranger(number - len(self._agents))


def _number_of_stranger(name: str, agents: int) -> int:
    number = stranger_number(name)
    if number is None:
        raise InvalidValueError(f"a sender must be an agent or '{stranger(0)}', '{stranger(1)}', ..., got {name!r}")
    return agents + number


def pack_covariances(poses: Sequence[PoseEstimate]) -> Floats:
    """Return the poses' covariances (N, 3, 3), zeros where a pose states none."""
    stated = [np.zeros((3, 3)) if pose.covariance is None else pose.covariance for pose in poses]
    return np.array(stated).reshape(-1, 3, 3)


def stated_covariance(covariance: Any) -> Any:
    """Return a covariance, or None for the zeros that stand for none."""
    return None if covariance is None or not np.any(covariance) else covariance
