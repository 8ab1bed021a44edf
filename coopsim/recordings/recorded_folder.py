"""Interface of folders with recordings, one subclass for each format: sequences, frames, agents and pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_between, require_choice, require_frame_time
from coopsim.support.pictures import opened_picture
from coopsim.types import CameraCalibration, Ints, Sweep
from coopsim.types.messages import AGENT_KINDS

CAR = "car"
"""Recorded name of the agent in a folder of one car."""


UNRELATED_S = 0.5
"""Time between frames that are no film, as of KITTI's object benchmark: beyond the 0.25 s within which networks join
sweeps."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPicture:
    """Picture of a camera, a file that is read when asked for.

    Attributes:
        path: PNG or JPEG file.
        calibration: calibration of the camera in this frame.
    """

    path: Path
    calibration: CameraCalibration

    def rgb(self) -> NDArray[np.uint8]:
        """Return the pixels (H, W, 3).

        Raises:
            RecordingError: the file is missing, broken, or of another size than the camera's pictures.
        """
        with opened_picture(self.path) as picture:
            pixels = np.asarray(picture.convert("RGB"))
        if pixels.shape[:2] != self.calibration.size:
            height, width = self.calibration.size
            raise RecordingError(
                f"{self.path}: a picture of {width} x {height} pixels is needed, got "
                f"{pixels.shape[1]} x {pixels.shape[0]}"
            )
        return pixels


def find_picture(path: Path, matrix: Floats, base_SE3_camera: SE3, distortion: Floats | None = None) -> RecordedPicture:
    """Return the picture of a file, of which only the size is read.

    Args:
        path: PNG or JPEG file.
        matrix: (3, 3), the camera's K; with a skew or another scale it is refused.
        base_SE3_camera: its pose in the base frame, x right, y down, z forward.
        distortion: (5,) k1, k2, p1, p2, k3; None: there is none.

    Raises:
        RecordingError: the file is missing or no picture, or the matrix is none of a camera.
    """
    try:
        lens = np.zeros(5) if distortion is None else distortion
        calibration = CameraCalibration(picture_size(path), matrix, lens, base_SE3_camera)
    except InvalidValueError as error:
        raise RecordingError(f"{path}: its camera's {error}") from error
    return RecordedPicture(path, calibration)


def picture_size(path: Path) -> tuple[int, int]:
    """Return height and width of the picture of a file.

    Raises:
        RecordingError: the file is missing or no picture.
    """
    with opened_picture(path) as picture:
        width, height = picture.size
    return height, width


@dataclass(frozen=True, slots=True)
class RecordedName:
    """The name of an agent in a recording, and what it is.

    Attributes:
        recorded: its name there, as "641".
        kind: "cav", "rsu" or "drone".
    """

    recorded: str
    kind: Literal["cav", "rsu", "drone"]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedObjects:
    """N labelled objects.

    Attributes:
        id: (N,) >= 1, unique, and constant over a sequence.
        boxes: upright boxes in the world frame.
        label: (N,) an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    label: Ints

    def __len__(self) -> int:
        return len(self.id)

    def __getitem__(self, rows: Ints) -> RecordedObjects:
        return RecordedObjects(self.id[rows], self.boxes[rows], self.label[rows])


@dataclass(frozen=True, slots=True, eq=False)
class RecordedAgent:
    """Agent in a frame.

    Attributes:
        world_SE3_base: its pose, upright: x along its heading, on the ground under it.
        base_SE3_lidar: pose of its LiDAR, with the tilt that it has in this frame.
        read_sweep: returns its points in the base frame; reads a file at each call.
        find_pictures: returns its pictures, by camera; looks for files at each call.
        object_id: its own id among the objects; None: not known, or it is no object.
    """

    world_SE3_base: SE3
    base_SE3_lidar: SE3
    read_sweep: Callable[[], Sweep]
    find_pictures: Callable[[], Mapping[str, RecordedPicture]] = dict
    object_id: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrame:
    """All agents at one moment, and the union of the objects that were labelled for any of them.

    Attributes:
        time_ns: since the sequence's first frame.
        agents: agents by coopsim's names, as "cav_0".
        objects: the labels.
        doubtful: (K, 7) boxes in the world frame where an object may be that is not labelled.
    """

    time_ns: int
    agents: Mapping[str, RecordedAgent]
    objects: RecordedObjects
    doubtful: Floats = field(default_factory=lambda: np.zeros((0, 7)))


POSE_SOURCES = ("auto", "poses", "none")
"""Sources of the agents' motion."""

IN_PICTURE = "picture"

POINTS = (IN_PICTURE, "all")
"""Which points of a cloud are kept, of which a part is labelled."""


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """Choices that the files of a format leave open.

    Attributes:
        frame_s: time between two recorded frames where they have no time stamps; None: the format's, 0.1 s.
        lidar_height_m: height of LiDARs over the ground where it is not in the files; a number for all agents, or one
            by kind ("cav", "rsu", "drone"); None: the format's.
        points: "picture" keeps, of KITTI's clouds and of arrays with a `fov_deg`, what is in the labelled view; "all"
            keeps all.
        odometry: source of the agents' motion: "poses", of the files; "auto", the same; "none", for a single agent
            whose labels are in its own frame: as if it stood still.
        labelled: False: labels of plain arrays are not read, and may be missing.

    Raises:
        InvalidValueError: a value is not accepted.
    """

    frame_s: float | None = None
    lidar_height_m: float | Mapping[str, float] | None = None
    odometry: str = "auto"
    points: str = "picture"
    labelled: bool = True

    def __post_init__(self) -> None:
        require_choice("odometry", self.odometry, POSE_SOURCES, "in a folder with sweeps")
        require_choice("points", self.points, POINTS)
        if self.frame_s is not None:
            require_frame_time(self.frame_s)
        heights = self.lidar_height_m if isinstance(self.lidar_height_m, Mapping) else {"": self.lidar_height_m}
        for kind, height_m in heights.items():
            if kind not in ("", *AGENT_KINDS):
                raise InvalidValueError(f"lidar_height_m must be by kind ({', '.join(AGENT_KINDS)}), got {kind!r}")
            if height_m is not None:
                require_between(0, 100, lidar_height_m=height_m)

    def height_m(self, kind: str, usual: Mapping[str, float]) -> float:
        """Return the height of the LiDARs of a kind of agent, or the usual one."""
        given = self.lidar_height_m
        if isinstance(given, Mapping):
            given = given.get(kind)
        return usual.get(kind, usual["cav"]) if given is None else float(given)


@dataclass(frozen=True)
class RecordedSequence(ABC):
    """Sequence of a folder. Only names of files are known before a frame is asked for.

    Attributes:
        agents: agents in each of its frames, by coopsim's names: "cav_0", "cav_1", ..., "rsu_0", ...
        frame_s: time between two frames; those with time stamps may differ from it a little.
    """

    name: str
    agents: Mapping[str, RecordedName]
    frame_s: float

    @property
    @abstractmethod
    def frames(self) -> int:
        """Number of frames."""

    @abstractmethod
    def frame(self, number: int) -> RecordedFrame:
        """Return a frame by its number from 0.

        Raises:
            RecordingError: a file is missing or broken; names file and field.
        """


@dataclass(frozen=True)
class RecordedFolder(ABC):
    """A folder with sequences of one format."""

    path: Path
    options: ReadingOptions = field(default_factory=ReadingOptions)

    stands_alone: ClassVar[bool] = False
    """Whether there is one agent, with labels in its own frame, so that its poses are not needed."""

    usual_frame_s: ClassVar[float] = 0.1
    """Time between two frames where neither the files nor the options say it."""

    usual_height_m: ClassVar[Mapping[str, float]]
    """Height of LiDARs over the ground, by kind of agent, where neither the files nor the options say it."""

    layout: ClassVar[str] = ""
    """Names by which a folder of the format is known, in words for errors; empty: it is opened by name alone."""

    asked: ClassVar[int] = 50
    """Turn in which formats are asked whether a folder is theirs; those that can only guess come late."""

    @classmethod
    def found_in(cls, path: Path) -> bool:
        """Return whether a folder has this format, by the names in it and at most one frame."""
        return False

    def __post_init__(self) -> None:
        if self.options.odometry == "none" and not self.stands_alone:
            raise InvalidValueError("odometry must be 'auto' or 'poses' here: poses place the agents and their labels")

    @property
    def frame_s(self) -> float:
        """Time between two recorded frames."""
        return self.usual_frame_s if self.options.frame_s is None else float(self.options.frame_s)

    @property
    @abstractmethod
    def sequences(self) -> tuple[str, ...]:
        """Names of the sequences, sorted."""

    @abstractmethod
    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        """Return the agents of a sequence, as `RecordedSequence.agents`, without a look at its frames.

        Raises:
            RecordingError: an agent's name is broken.
        """

    def open(self, sequence: str) -> RecordedSequence:
        """List the frames of a sequence.

        Raises:
            UnknownNameError: there is no such sequence.
            RecordingError: it has no frame, or its agents have different ones.
        """
        require_choice("sequence", sequence, self.sequences, f"in {self.path}")
        return self._open(sequence)

    @abstractmethod
    def _open(self, sequence: str) -> RecordedSequence:
        """List the frames of a sequence that there is."""


@dataclass(frozen=True)
class SingleCarFolder(RecordedFolder):
    """A folder with sequences of one car."""

    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        return name_agents((CAR,))


def name_agents(
    cars: tuple[str, ...], masts: tuple[str, ...] = (), drones: tuple[str, ...] = ()
) -> dict[str, RecordedName]:
    """Return coopsim's names of cars, roadside units and drones, each in the order of the recording."""
    named: dict[str, RecordedName] = {}
    kinds: tuple[tuple[Literal["cav", "rsu", "drone"], tuple[str, ...]], ...]
    kinds = ("cav", cars), ("rsu", masts), ("drone", drones)
    for kind, names in kinds:
        named |= {f"{kind}_{k}": RecordedName(name, kind) for k, name in enumerate(names)}
    return named
