"""Sources of clips without a simulator, whose class worker processes can import."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip, Scene


@dataclass
class NumberedClips:
    """Clips of one frame with no agent, called by their numbers.

    Attributes:
        fails_at: index of the clip that cannot be made; -1: none.
        why: how it fails: "coopsim", "other" or "killed".
        notes: folder for an empty file `INDEX_PID` of every clip that is made.
        values: objects of a clip.
    """

    fails_at: int = -1
    why: str = "coopsim"
    notes: Path | None = None
    values: int = 1

    def clip(self, index: int) -> Clip:
        if self.notes is not None:
            (self.notes / f"{index}_{os.getpid()}").touch()
        print("a source may print")
        if index == self.fails_at:
            self._fail(index)
        n = self.values
        ids, boxes, velocity = np.arange(1, n + 1), np.zeros((n, 7)), np.zeros((n, 2))
        scene = Scene(0, (), ids, boxes, velocity, np.zeros(n, np.int64), np.zeros((n, 0), np.int64))
        return Clip(f"clip {index}", 0.1, (scene,))

    def _fail(self, index: int) -> None:
        if self.why == "coopsim":
            raise InvalidValueError(f"there is no clip {index}")
        if self.why == "other":
            raise ZeroDivisionError
        os.kill(os.getpid(), signal.SIGKILL)
