"""Windows of recordings and their tracks: what a filter is trained on in the place of simulated clips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.learn.recorded.recorded_frames import frames_of
from coopsim.learn.recorded.training_recordings import RecordedWorld
from coopsim.learn.recorded.window_tracks import WindowTracks, track_frames
from coopsim.support.rng import stream
from coopsim.tracking.motion.constant_velocity import ConstantVelocity


@dataclass(frozen=True, slots=True, eq=False)
class RecordedWindow:
    """Successive frames of a recording, and the tracks in them.

    Attributes:
        numbers: (M, 19) of the window's detections, see `box_numbers`.
        tracks: which detections each track consists of.
        dt_s: time between two frames.
        heading_rad: (M,) of the agents that detected them, in the frame of the boxes: variances are along and across
            it; None: along the axes of the frame, the owner's.
        patches: (M, 9 C) of `box_patches`; None: the recording has no features.
    """

    numbers: Floats
    tracks: WindowTracks
    dt_s: float
    heading_rad: Floats | None = None
    patches: Floats | None = None


class RecordedWindows:
    """Windows of the recordings that are trained on, by number: one recording after the other, from a random frame.

    Each recording is tracked once, by AB3DMOT with its own noise, the agents in turn: so the association does not
    depend on what is learned.

    Args:
        world: the recordings.
        seed: of the frames.

    Raises:
        CoopsimError: as `RecordedWorld.folder` and `trained_on`; or a file is missing or broken.
    """

    def __init__(self, world: RecordedWorld, seed: int) -> None:
        folder = world.folder()
        self._world, self._seed = world, seed
        self._recordings = [
            frames_of(folder.load(name, world.detections), world.dt_s) for name in world.trained_on(folder.sequences)
        ]
        self._tracks: dict[int, WindowTracks] = {}

    def clip(self, index: int) -> RecordedWindow:
        """Return a window: the same for the same index."""
        number = index % len(self._recordings)
        recording, length = self._recordings[number], self._world.frames
        if number not in self._tracks:
            self._tracks[number] = track_frames(recording, np.ones((len(recording.numbers), 7)), ConstantVelocity())
        last = max(0, len(recording.found) - length)
        first = int(stream(self._seed, "training.window", str(index)).integers(last + 1))
        tracks, rows = self._tracks[number].cut(first, length)
        return RecordedWindow(recording.numbers[rows], tracks, recording.dt_s)
