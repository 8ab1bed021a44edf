"""Clips from recordings with sweeps: the same arrays as from the simulator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from coopsim.learn.clips.arrays import MOST_M, round_points
from coopsim.learn.clips.clip import AgentScene, Clip, ClipSource, Scene
from coopsim.localization.localizer import LocalizationConfig, Localizer
from coopsim.recordings.formats import open_folder
from coopsim.recordings.recorded_folder import RecordedFolder, RecordedSequence
from coopsim.recordings.recorded_scene import RecordedScenes, returns_of
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed, stream
from coopsim.types import Sweep, stack_xyz_yaw

_LIDAR = "lidar"


@dataclass(frozen=True, slots=True)
class RecordedClips:
    """Clips of recordings, with a folder, a sequence and a first frame drawn for each.

    Poses are the recorded ones, odometry is theirs with the usual small errors. Points farther than a clip can hold are
    left out. The objects are the labels, and their numbers of returns are those of the points in their boxes.

    Attributes:
        folders: paths of folders with sweeps (`coopsim.data.recordings`), each as likely.
        frames: frames in a clip; fewer where a sequence is shorter.
        dt_s: times between two frames, of which each clip takes one, rounded to a multiple of the recording's.
        seed: another one gives other clips.
    """

    folders: tuple[str, ...]
    frames: int
    dt_s: tuple[float, ...]
    seed: int = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
        require_count(1, frames=self.frames)

    def clip(self, index: int) -> Clip:
        """Return a clip: the same bits for the same files, arguments and index.

        Raises:
            InvalidValueError: the index is no count.
            RecordingError: a folder has no known format, or a file is broken; names it.
        """
        require_count(0, index=index)
        rng = stream(self.seed, "recording", "clip", str(index))
        path = self.folders[int(rng.integers(len(self.folders)))]
        folder = _folder(path)
        name = folder.sequences[int(rng.integers(len(folder.sequences)))]
        sequence = _sequence(path, name)
        dt_s = self.dt_s[int(rng.integers(len(self.dt_s)))]
        every, first = self._span(sequence, dt_s, rng)
        scenes = tuple(self._scenes(RecordedScenes(sequence, every, first), index))
        key = f"{path}, {name}, frame {first}, every {every}, seed {self.seed}, clip {index}"
        return Clip(key, every * sequence.frame_s, scenes)

    def _span(self, sequence: RecordedSequence, dt_s: float, rng: np.random.Generator) -> tuple[int, int]:
        """Return the stride and the first of the recorded frames of a clip."""
        wanted = max(1, round(dt_s / sequence.frame_s))
        most = max(1, (sequence.frames - 1) // max(1, self.frames - 1))
        every = min(wanted, most)
        last = max(0, sequence.frames - 1 - every * (self.frames - 1))
        return every, int(rng.integers(last + 1))

    def _scenes(self, scenes: RecordedScenes, index: int) -> Iterator[Scene]:
        begun = scenes.frame(0)
        dt_s = max(1e-3, (scenes.frame(1).time_ns - begun.time_ns) / 1e9) if len(scenes) > 1 else 0.1
        localizers = {
            name: Localizer(LocalizationConfig(), self.seed + index, name, dt_s, stands=body.kind == "rsu")
            for name, body in scenes.bodies(0).items()
        }
        for number in range(min(self.frames, len(scenes))):
            frame, actors, bodies = scenes.frame(number), scenes.actors(number), scenes.bodies(number)
            sweeps = {name: {_LIDAR: _near(agent.read_sweep())} for name, agent in frame.agents.items()}
            agents = []
            for name, body in bodies.items():
                _, odometry = localizers[name].localize(body.world_SE3_base)
                sweep = sweeps[name][_LIDAR]
                points = round_points(np.column_stack([sweep.points, sweep.intensity]))
                pose = stack_xyz_yaw(body.world_SE3_base)
                agents.append(AgentScene(name, body.kind, pose, odometry.xyz_yaw, points, body.actor_id))
            yield Scene(
                time_ns=frame.time_ns - begun.time_ns,
                agents=tuple(agents),
                object_id=actors.id,
                boxes=actors.boxes.array,
                velocity=actors.velocity,
                label=actors.label,
                returns=returns_of(actors, bodies, sweeps),
                doubtful=frame.doubtful if len(frame.doubtful) else None,
            )


@dataclass(frozen=True, slots=True)
class MixedClips:
    """Clips of two sources, drawn for each number: from the first one in this share of cases."""

    first: ClipSource
    second: ClipSource
    share: float
    seed: int

    def clip(self, index: int) -> Clip:
        """Return a clip by its number from 0."""
        taken = self.first if stream(self.seed, "source", "clip", str(index)).random() < self.share else self.second
        clip: Clip = taken.clip(index)
        return clip


def _near(sweep: Sweep) -> Sweep:
    kept = (np.abs(sweep.points) <= MOST_M).all(axis=1)
    return sweep if kept.all() else Sweep(sweep.points[kept], sweep.intensity[kept], sweep.beam[kept])


@lru_cache(maxsize=8)
def _folder(path: str) -> RecordedFolder:
    return open_folder(path)


@lru_cache(maxsize=256)
def _sequence(path: str, name: str) -> RecordedSequence:
    return _folder(path).open(name)
