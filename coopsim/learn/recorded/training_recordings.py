"""Which recordings a training reads, and which it holds out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from coopsim.data.kitti import AXES
from coopsim.data.recording_set import RecordingSet
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice, require_count, require_flag, require_frame_time

DATA = "COOPSIM_DATA"
"""The environment variable with the folder that relative paths begin at."""

VALIDATION = ("0000",)
"""Recordings among V2V4Real's training recordings that are validation recordings."""


@dataclass(frozen=True, slots=True)
class RecordedWorld:
    """The option `world` of trainings on recordings.

    Attributes:
        path: folder of a recording set; a relative one begins at the folder that `COOPSIM_DATA` names.
        detections: names of detections, the frame's owner first.
        without: recordings that are not used.
        held_out: recordings to choose by, which are not trained on.
        axes: convention of the files' axes, see `coopsim.data.kitti`.
        dt_s: time between two frames.
        frames: of a window.
        allow_validation: recordings of V2V4Real's validation among the training ones may be used.
    """

    path: str = "v2v4real/train"
    detections: tuple[str, ...] = ("ego", "1")
    without: tuple[str, ...] = VALIDATION
    held_out: tuple[str, ...] = ("0026", "0027", "0028", "0029", "0030", "0031")
    axes: str = "kitti"
    dt_s: float = 0.1
    frames: int = 20
    allow_validation: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.path, (str, Path)):
            raise InvalidValueError(f"path must be the folder of a recording set, got {self.path!r}")
        for name in ("detections", "without", "held_out"):
            given = getattr(self, name)
            if not isinstance(given, (tuple, list)) or not all(isinstance(each, str) for each in given):
                raise InvalidValueError(f"{name} must be names, as [0000, 0001], got {given!r}")
            object.__setattr__(self, name, tuple(given))
        require_choice("axes", self.axes, AXES)
        require_frame_time(self.dt_s)
        require_count(2, 1000, frames=self.frames)
        require_flag(allow_validation=self.allow_validation)
        if not self.detections:
            raise InvalidValueError("detections must be at least one name, got none")

    def folder(self) -> RecordingSet:
        """Return the recording set.

        Raises:
            InvalidValueError: the path is relative, and `COOPSIM_DATA` is not set.
            RecordingError: there is none.
        """
        path, root = Path(self.path).expanduser(), os.environ.get(DATA)
        if not path.is_absolute():
            if root is None:
                raise InvalidValueError(
                    f"world.path must be absolute, or {DATA} the folder in which {self.path!r} is, got no {DATA}"
                )
            path = Path(root) / path
        return RecordingSet(path, self.axes)

    def trained_on(self, known: Sequence[str]) -> tuple[str, ...]:
        """Return the recordings of a set to train on.

        Raises:
            UnknownNameError: a recording to hold out is not there.
            InvalidValueError: none is left, or a validation recording is among them.
        """
        for name in self.held_out:
            require_choice("held_out", name, known)
        kept = tuple(name for name in known if name not in (*self.without, *self.held_out))
        if not kept:
            raise InvalidValueError(f"there must be a recording to train on besides {', '.join(known)}")
        forbidden = [name for name in VALIDATION if name in kept]
        if forbidden and not self.allow_validation:
            raise InvalidValueError(
                f"without must have {', '.join(forbidden)}, which V2V4Real validates on: leave it out, or say "
                "allow_validation if these are other recordings"
            )
        return kept
