"""The interface of folders with recordings: one subclass for each format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from coopsim.data.recordings.recorded_frame import RecordedFrame, RecordedName
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_between, require_choice, require_frame_time
from coopsim.types.messages import AGENT_KINDS

POSE_SOURCES = ("auto", "poses", "none")
"""Sources of the agents' motion."""

IN_PICTURE = "picture"

POINTS = (IN_PICTURE, "all")
"""Which points of a cloud are kept, of which a part is labelled."""


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """What the files of a format leave open.

    Attributes:
        frame_s: time between two recorded frames where they have no time stamps; None: the format's, 0.1 s.
        lidar_height_m: height of LiDARs over the ground where it is not in the files; a number for all agents, or one
            by kind ("cav", "rsu", "drone"); None: the format's.
        points: "picture" keeps, of KITTI's clouds, what is in the picture, as only that is labelled; "all" keeps all.
        odometry: how the agents' motion is known: "poses", of the files; "auto", the same; "none", for a single agent
            whose labels are in its own frame: as if it stood still.

    Raises:
        InvalidValueError: a value is not accepted.
    """

    frame_s: float | None = None
    lidar_height_m: float | Mapping[str, float] | None = None
    odometry: str = "auto"
    points: str = "picture"

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
    """One sequence of a folder. Only names of files are known before a frame is asked for.

    Attributes:
        name: of the sequence.
        agents: what agents there are in each of its frames, by coopsim's names: "cav_0", "cav_1", ..., "rsu_0", ...
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
    """A folder with sequences of one format.

    Attributes:
        path: the folder.
        options: what its files leave open.
    """

    path: Path
    options: ReadingOptions = field(default_factory=ReadingOptions)

    stands_alone: ClassVar[bool] = False
    """Whether there is one agent, with labels in its own frame, so that its poses are not needed."""

    usual_frame_s: ClassVar[float] = 0.1
    """Time between two frames where neither the files nor the options say it."""

    usual_height_m: ClassVar[Mapping[str, float]]
    """Height of LiDARs over the ground, by kind of agent, where neither the files nor the options say it."""

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

    @abstractmethod
    def open(self, sequence: str) -> RecordedSequence:
        """List the frames of a sequence.

        Raises:
            UnknownNameError: there is no such sequence.
            RecordingError: it has no frame, or its agents have different ones.
        """


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
