"""Messages of fixed shape: as numbers in [-1, 1], and with scores in the order of the rows that a learner sees.

| numbers | from -1 to 1 stands for |
|---|---|
| a number for each score, or for each cell of the map, row by row | 0 to 1 |
| with `to`, one for each agent | whether the message is for it: above 0 |
| with `ask`, one for each agent | whether it is asked: above 0 |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces

from coopsim.envs.wrappers.base_wrappers import AnySpace
from coopsim.errors import CoopsimError, InvalidActionError, InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers
from coopsim.types import Ints
from coopsim.types.messages import MessagePart
from coopsim.wire.actions import MESSAGE


def numbers_of(part: MessagePart) -> int:
    """Return how many numbers a message is.

    Raises:
        InvalidValueError: it has no fixed shape.
    """
    if part.form == "payload":
        raise InvalidValueError("env must have messages of a fixed shape: form=scores or form=cells, got form=payload")
    return part.size ** (2 if part.form == "cells" else 1) + len(part.agents) * (part.to + part.ask)


def as_message(numbers: Floats, part: MessagePart) -> dict[str, Any]:
    """Return the message for numbers (N,) in [-1, 1]; see the module."""
    ends = np.cumsum([numbers_of(replace(part, to=False, ask=False)), len(part.agents) * part.to])
    score, to, ask = np.split(numbers, ends)
    message: dict[str, Any] = {"score": (score.reshape((part.size, -1)) if part.form == "cells" else score) / 2 + 0.5}
    message |= {"to": (to > 0).astype(np.int8)} if part.to else {}
    return message | ({"ask": (ask > 0).astype(np.int8)} if part.ask else {})


class ScoresByRow:
    """Scores of messages in the order of rows that a learner sees, for actions that are dicts or numbers.

    Args:
        part: part of the environment's actions, with scores.
        rows: number of rows.
    """

    def __init__(self, part: MessagePart, rows: int) -> None:
        self._part, self._rows = part, rows
        self._low, self._length = 0.0, 0

    def space(self, inner: AnySpace) -> AnySpace:
        """Return the space of actions with a score for each row."""
        if isinstance(inner, spaces.Dict):
            parts = {
                name: self.space(each) if name in (MESSAGE, "score") else each for name, each in inner.spaces.items()
            }
            return spaces.Dict(parts)
        if not isinstance(inner, spaces.Box):
            return inner
        self._low = float(inner.low.min())
        self._length = inner.shape[0] - self._part.size + self._rows
        return spaces.Box(self._low, float(inner.high.max()), (self._length,))

    def act(self, agent: str, action: Any, indices: Ints) -> Any:
        """Return the environment's action; `indices` (R,) are the detections of the rows that have any.

        Raises:
            InvalidActionError: it is no dict, and has another shape than its space.
        """
        if action is None:  # nothing is said
            return None
        if isinstance(action, Mapping):
            return {
                name: self.act(agent, each, indices) if name in (MESSAGE, "score") else each
                for name, each in action.items()
            }
        try:
            numbers = as_numbers(action, np.float64, "action")
        except CoopsimError as error:
            raise InvalidActionError(f"{agent}: {error}") from error
        if numbers.shape != (self._length,):
            raise InvalidActionError(f"{agent}: action must have shape {(self._length,)}, got {numbers.shape}")
        rest = numbers_of(self._part) - self._part.size
        begin = self._length - rest - self._rows
        scores = np.full(self._part.size, self._low)
        known = indices < self._part.size
        scores[indices[known]] = numbers[begin : begin + len(indices)][known]
        return np.concatenate([numbers[:begin], scores, numbers[self._length - rest :]])
