"""The format of an action's `message`: its gymnasium space, its default, and what it says, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from coopsim.errors import CoopsimError, InvalidActionError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers, require_finite
from coopsim.types import Detections, Mask
from coopsim.types.messages import MessagePart, Said


class PayloadSpace(spaces.Sequence):
    """Space of payloads, as bytes (B, 1) in rows. A sample is empty, as random bytes are no message."""

    def __init__(self) -> None:
        super().__init__(spaces.Box(0, 255, (1,), np.uint8), stack=True)

    def sample(self, mask: Any = None, probability: Any = None) -> Any:
        """Return an empty payload."""
        return np.zeros((0, 1), np.uint8)


def message_space(part: MessagePart) -> spaces.Dict:
    """Return a new space of an action's `message`."""
    parts: dict[str, spaces.Space[Any]] = {}
    if part.form == "payload":
        parts["payload"] = PayloadSpace()
    else:
        parts["score"] = spaces.Box(0.0, 1.0, _shape(part), np.float32)
    parts |= {name: spaces.MultiBinary(len(part.agents)) for name in _masks(part)}
    return spaces.Dict(parts)


def everything(part: MessagePart, found: Detections) -> dict[str, Any] | None:
    """Return the message that sends all detections to all agents, the surest first; None: nothing, for payloads."""
    if part.form == "payload":
        return None
    masks = {name: np.ones(len(part.agents), np.int8) for name in _masks(part)}
    if part.form == "cells":
        return {"score": np.ones(_shape(part), np.float32), **masks}
    score = np.zeros(part.size, np.float32)
    count = min(part.size, len(found))
    score[:count] = np.clip(found.score[:count], np.finfo(np.float32).tiny, 1.0)
    return {"score": score, **masks}


def unpack_message(agent: str, given: object, part: MessagePart) -> Said:
    """Return what the part `message` of an agent's action says; None, or no payload, says nothing.

    Raises:
        InvalidActionError: names the agent, what is wrong, and what is accepted.
    """
    if given is None:
        return Said(ask=np.zeros(len(part.agents), np.bool_) if part.ask else None)
    content = "payload" if part.form == "payload" else "score"
    wanted = {content, *_masks(part)}
    if not isinstance(given, Mapping) or set(given) != wanted:
        got = sorted(map(str, given)) if isinstance(given, Mapping) else repr(given)
        raise InvalidActionError(f"{agent}: message must be None or a dict with {sorted(wanted)}, got {got}")
    try:
        to, ask = (_mask(given[name], name, part) if name in given else None for name in ("to", "ask"))
        if content == "payload":
            return Said(payload=_payload(given["payload"]), to=to, ask=ask)
        return Said(score=_scores(given["score"], part), to=to, ask=ask)
    except CoopsimError as error:
        raise InvalidActionError(f"{agent}: {error}") from error


def _masks(part: MessagePart) -> tuple[str, ...]:
    return ("to",) * part.to + ("ask",) * part.ask


def _shape(part: MessagePart) -> tuple[int, ...]:
    return (part.size,) * (2 if part.form == "cells" else 1)


def _scores(given: Any, part: MessagePart) -> Floats:
    score = as_numbers(given, np.float64, "message score").copy()
    if score.shape != _shape(part):
        raise InvalidActionError(f"message score must have shape {_shape(part)}, got {score.shape}")
    require_finite(score, "message score")
    if not 0 <= score.min() <= score.max() <= 1:
        raise InvalidActionError(f"message score must be in [0, 1], got {score.min():g} to {score.max():g}")
    return score


def _payload(given: Any) -> bytes | None:
    if isinstance(given, bytes):
        return given or None
    numbers = as_numbers(given, np.int64, "message payload")
    if numbers.ndim > 2 or (numbers.ndim == 2 and numbers.shape[1] != 1):
        raise InvalidActionError(f"message payload must be bytes or their numbers (B,) or (B, 1), got {numbers.shape}")
    if numbers.size and not 0 <= numbers.min() <= numbers.max() <= 255:
        raise InvalidActionError(f"message payload must be numbers in 0..255, got {numbers.min()} to {numbers.max()}")
    return numbers.astype(np.uint8).tobytes() or None


def _mask(given: Any, name: str, part: MessagePart) -> Mask:
    chosen = np.asarray(given)
    if chosen.dtype.kind not in "biu" or chosen.shape != (len(part.agents),) or not np.isin(chosen, (0, 1)).all():
        agents = ", ".join(part.agents)
        raise InvalidActionError(f"message {name} must be a 0 or 1 for each of {agents}, got {given!r}")
    return chosen.astype(np.bool_)
