"""Pasting: reads sweeps without labels, places actors in them, and writes frames of plain arrays with labels."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.paste.actors import PlacedActors, Stage, place_actors
from coopsim.learn.paste.free_ground import FreeGround
from coopsim.learn.paste.rays import SweepRays, find_sensor, rays_of
from coopsim.learn.paste.returns import Optics, cast, match_intensities
from coopsim.recordings.formats import open_folder
from coopsim.recordings.recorded_folder import UNRELATED_S, ReadingOptions, RecordedSequence
from coopsim.support.checks import require_between, require_count
from coopsim.support.files import make_folder, write_whole_bytes
from coopsim.support.rng import require_seed, stream
from coopsim.types import NS_PER_S
from coopsim.types.taxonomy import ObjectClass

FindObjects = Callable[[NDArray[np.float32]], Floats]
"""Returns boxes (K, 7) where points (N, 4) may show an object."""


@dataclass(frozen=True, slots=True)
class PasteSettings:
    """Options of pasting.

    Attributes:
        actors: least and most actors that are drawn for a sweep; those that find no free ground are left out.
        reach_m: farthest place of an actor.
        frames: consecutive sweeps in which the same actors stand or move.
        copies: number of uses of each sweep, each with other actors.
        seed: seed of all that is drawn.
        lidar_height_m: height of the LiDAR over the ground where files do not say it; None: as for other recordings.
    """

    actors: tuple[int, int] = (4, 12)
    reach_m: float = 50.0
    frames: int = 1
    copies: int = 1
    seed: int = 0
    lidar_height_m: float | None = None

    def __post_init__(self) -> None:
        require_count(1, frames=self.frames, copies=self.copies)
        require_count(0, 100, actors=self.actors[0])
        require_count(self.actors[0], 100, actors=self.actors[1])
        require_between(10, 60, reach_m=self.reach_m)
        require_seed(self.seed)


@dataclass(frozen=True, slots=True, eq=False)
class RealFrame:
    """A sweep, and what is found in it.

    Attributes:
        points: (N, 4) float32: x, y, z m in the base frame and intensity.
        stage: its place in the window, and its ground.
        rays: its rays.
        doubtful: (K, 7) boxes of what the detector may see in it.
        world_SE3_base: pose of the base frame.
    """

    points: NDArray[np.float32]
    stage: Stage
    rays: SweepRays
    doubtful: Floats
    world_SE3_base: SE3


@dataclass(frozen=True, slots=True, eq=False)
class PastedFrame:
    """A frame with labels, beside the sweep that it was made of.

    Attributes:
        path: file.
        before: (N, 4) the sweep.
        points: (P, 4) with the actors' returns last.
        boxes: (A, 7) of actors with a return.
        doubtful: (K, 7) boxes that are neither labelled nor empty.
    """

    path: Path
    before: NDArray[np.float32]
    points: NDArray[np.float32]
    boxes: Floats
    doubtful: Floats


def paste(sweeps: Path, out: Path, settings: PasteSettings, find_objects: FindObjects) -> Iterator[PastedFrame]:
    """Paste actors into all sweeps of a folder, and write the frames into another, which must be empty; yield them.

    Raises:
        InvalidValueError: a value is not accepted.
        RecordingError: the folder has no sweeps, or a file is broken; names it.
    """
    options = ReadingOptions(points="all", labelled=False, lidar_height_m=settings.lidar_height_m)
    folder = open_folder(sweeps, options)
    make_folder(out)
    if next(out.iterdir(), None) is not None:
        raise InvalidValueError(f"{out} must be an empty folder, or one that does not exist yet")
    for name in folder.sequences:
        sequence = folder.open(name)
        for first in range(0, sequence.frames, settings.frames):
            window = _read(sequence, range(first, min(first + settings.frames, sequence.frames)), find_objects)
            for copy in range(settings.copies):
                yield from _paste_window(window, out, name, first, copy, settings)


def _read(sequence: RecordedSequence, numbers: Sequence[int], find_objects: FindObjects) -> list[RealFrame]:
    """Read the sweeps of a window, of the recording's first agent."""
    frames = list[RealFrame]()
    read = [sequence.frame(number) for number in numbers]
    apart_s = np.diff([frame.time_ns / NS_PER_S for frame in read]).max(initial=0.0)
    if apart_s >= UNRELATED_S:
        raise InvalidValueError(
            f"frames must be 1: sweeps of {sequence.name!r} are {apart_s:g} s apart, or have no times, so are unrelated"
        )
    agents = [next(iter(frame.agents.values())) for frame in read]
    for frame, agent in zip(read, agents, strict=True):
        sweep = agent.read_sweep()
        points: NDArray[np.float32] = np.column_stack([sweep.points, sweep.intensity]).astype(np.float32)
        places = points[:, :3].astype(np.float64)
        sensor = find_sensor(places, agent.base_SE3_lidar.translation)
        doubtful = find_objects(points)
        ground = FreeGround(places, sensor.origin_m)
        for box in doubtful:
            ground.take(box)
        pose = agents[0].world_SE3_base.inverse().compose(agent.world_SE3_base)
        stage = Stage(pose, (frame.time_ns - read[0].time_ns) / NS_PER_S, ground, sensor.origin_m)
        frames.append(RealFrame(points, stage, rays_of(places, sensor), doubtful, agent.world_SE3_base))
    return frames


def _paste_window(
    window: Sequence[RealFrame], out: Path, name: str, first: int, copy: int, settings: PasteSettings
) -> Iterator[PastedFrame]:
    """Place actors in the sweeps of a window, and write its frames."""
    rng = stream(settings.seed, "paste", name, str(first), str(copy))
    count = int(rng.integers(settings.actors[0], settings.actors[1] + 1))
    seed, optics = int(rng.integers(2**62)), Optics.draw(rng)
    stages = [replace(frame.stage, ground=frame.stage.ground.copy()) for frame in window]
    placed = place_actors(stages, count, settings.reach_m, seed)
    stem = f"{name.replace('/', '-')}-{copy}" if settings.frames == 1 else f"{name.replace('/', '-')}-{copy}-{first}"
    for number, frame in enumerate(window):
        made = paste_frame(frame, placed, number, optics, rng)
        if settings.frames > 1:
            made |= {"pose": _matrix(frame.world_SE3_base), "time_s": np.array(frame.stage.time_s)}
        else:
            del made["ids"]  # of unrelated frames
        path = out / f"{stem}_{first + number:06d}.npz"
        packed = io.BytesIO()
        np.savez_compressed(packed, allow_pickle=False, **made)
        write_whole_bytes(path, packed.getvalue())
        yield PastedFrame(path, frame.points, made["points"], made["boxes"], made["doubtful"])


def _matrix(pose: SE3) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def paste_frame(
    frame: RealFrame, placed: PlacedActors, number: int, optics: Optics, rng: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a window's frame of this number, with its actors' returns and labels."""
    found = cast(frame.rays, len(frame.points), placed.triangles(number), optics, rng)
    points = frame.points.astype(np.float64)
    above_m = points[:, 2] - frame.stage.ground.heights(points[:, :2])
    bright = match_intensities(found.light, points, above_m)
    own = np.column_stack([found.points, bright]).astype(np.float32)
    shows = np.isin(placed.actors.id, found.instance)
    boxes, doubtful = placed.boxes[number][shows], placed.boxes[number][~shows]
    return {
        "points": np.concatenate([frame.points[~found.hidden], own]),
        "boxes": boxes,
        "names": np.array([ObjectClass(each).title for each in placed.actors.label[shows].tolist()], np.str_),
        "ids": placed.actors.id[shows],
        "doubtful": np.concatenate([frame.doubtful, doubtful]),
    }
