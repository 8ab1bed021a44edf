"""A run of SUMO in this process, through libsumo, which holds one run at a time."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import weakref
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from coopsim.data.logs.filling import SIZES_M
from coopsim.data.logs.floating_cars import heading_and_velocity
from coopsim.errors import EpisodeStateError, InvalidValueError, MapFileError, MissingDependencyError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass

LONGEST_STEP_S = 0.1
"""Longest step of SUMO: vehicles of a second's step leap by their length and more."""

LEFT_OUT = -1
"""Class of what is no road user, such as ships and trains."""

_CLASSES: Mapping[str, int] = {
    **dict.fromkeys(("delivery", "emergency"), int(ObjectClass.VAN)),
    **dict.fromkeys(("truck", "trailer"), int(ObjectClass.TRUCK)),
    **dict.fromkeys(("bus", "coach", "tram"), int(ObjectClass.BUS)),
    **dict.fromkeys(("motorcycle", "moped"), int(ObjectClass.MOTORCYCLE)),
    "bicycle": int(ObjectClass.BICYCLE),
    "scooter": int(ObjectClass.SCOOTER),
    **dict.fromkeys(("pedestrian", "wheelchair"), int(ObjectClass.PEDESTRIAN)),
    **dict.fromkeys(
        ("rail", "rail_urban", "rail_electric", "rail_fast", "subway", "ship", "aircraft", "drone", "container"),
        LEFT_OUT,
    ),
    "cable_car": LEFT_OUT,
}
"""Classes by SUMO's `vClass`; others are cars."""

OPTIONS = {
    "collision.action": "warn",  # SUMO would lift cars that crash off the road
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",  # only bodies that touch
    "lanechange.duration": "2",  # in one step it would leap from lane to lane
    "no-step-log": "true",
    "no-warnings": "true",
    "route-steps": "0",  # all types of vehicles are known from the start
    "threads": "1",
    "xml-validation": "never",
}
_NOWHERE_M = 1e8  # SUMO puts road users that are on no road farther away
_ALL_CHECKS_OFF = 32
_MOST_LETTERS = 300  # of what SUMO says, in a message


@dataclass(frozen=True, slots=True)
class SumoRun:
    """Inputs of a run: the same inputs give the same bits.

    Attributes:
        network: file of a network, or its content.
        demand: file of a demand, or its content.
        seed: SUMO's.
        step_s: time of a step, whole milliseconds.
        begin_s: time at which it begins.
    """

    network: Path | str
    demand: Path | str
    seed: int
    step_s: float
    begin_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Users:
    """The N road users at one time, in the network's plane.

    Attributes:
        names: SUMO's.
        kind: (N,) number of the type.
        place: (N, 2) m, the middle of the footprint.
        heading: (N,) rad, counter-clockwise from x.
        velocity: (N, 2) m/s.
    """

    names: tuple[str, ...]
    kind: Ints
    place: Floats
    heading: Floats
    velocity: Floats

    def __getitem__(self, rows: Ints) -> Users:
        names = tuple(self.names[row] for row in rows.tolist())
        return Users(names, self.kind[rows], self.place[rows], self.heading[rows], self.velocity[rows])

    def joined(self, others: Users) -> Users:
        """Return these and others."""
        both = [np.concatenate([getattr(each, name) for each in (self, others)]) for name in self.__slots__[1:]]
        return Users(self.names + others.names, *both)


class SumoEngine:
    """The runs of one environment, one after another.

    Attributes:
        sumo: the library, while a run goes on.
        label: (T,) `ObjectClass` of each type of road users, or `LEFT_OUT`.
        size: (T, 3) length, width and height, m.
    """

    sumo: Any
    label: Ints
    size: Floats
    _holder: ClassVar[weakref.ref[SumoEngine] | None] = None

    def start(self, run: SumoRun) -> None:
        """Begin a run, in place of this engine's last one.

        Raises:
            MissingDependencyError: libsumo is not installed.
            EpisodeStateError: another environment of this process holds SUMO.
            MapFileError: SUMO refuses the network or the demand; says why.
        """
        self.sumo = _library()
        holder = None if SumoEngine._holder is None else SumoEngine._holder()
        if holder not in (None, self):
            raise EpisodeStateError(
                'another environment of this process has traffic="sumo", and SUMO runs once in a process: close that '
                "one, or make each in a process of its own"
            )
        SumoEngine._holder = weakref.ref(self)
        with contextlib.suppress(self.sumo.TraCIException):
            self.sumo.close()
        with TemporaryDirectory() as folder:
            self._load(run, Path(folder))
        known, names = self.sumo.vehicletype, self.sumo.vehicletype.getIDList()
        self._number = {name: k for k, name in enumerate(names)}  # of types
        self._kind_of: dict[str, int] = {}  # by road user
        self.label = np.array([_CLASSES.get(known.getVehicleClass(name), int(ObjectClass.CAR)) for name in names])
        self.size = np.array([[known.getLength(name), known.getWidth(name), known.getHeight(name)] for name in names])
        self.size[self.label == ObjectClass.PEDESTRIAN] = SIZES_M[ObjectClass.PEDESTRIAN]  # SUMO's are 0.2 m long
        self.size[self.label == LEFT_OUT] = SIZES_M[ObjectClass.CAR]  # they are nowhere

    def _load(self, run: SumoRun, folder: Path) -> None:
        options = {
            **OPTIONS,
            "net-file": str(_file(run.network, folder / "network.net.xml")),
            "route-files": str(_file(run.demand, folder / "demand.rou.xml")),
            "begin": repr(run.begin_s),
            "step-length": repr(run.step_s),
            "seed": str(run.seed % 2**31),
        }
        errors = folder / "errors.txt"
        try:
            with _told_to(errors):
                self.sumo.start(["sumo", *(word for name, value in options.items() for word in (f"--{name}", value))])
        except self.sumo.TraCIException:
            said = " ".join(errors.read_text(errors="replace").split())
            raise MapFileError(f"SUMO cannot run {_name(run.network)}: {said[:_MOST_LETTERS]}") from None

    def close(self) -> None:
        """End the run, and let other environments have SUMO."""
        if SumoEngine._holder is not None and SumoEngine._holder() is self:
            SumoEngine._holder = None
            with contextlib.suppress(self.sumo.TraCIException):
                self.sumo.close()

    @property
    def time_s(self) -> float:
        """SUMO's time."""
        return float(self.sumo.simulation.getTime())

    def go_on(self, until_s: float) -> None:
        """Step until a time.

        Raises:
            MapFileError: SUMO cannot go on; says why.
        """
        try:
            self.sumo.simulationStep(until_s)
        except self.sumo.TraCIException as error:
            raise MapFileError(f"SUMO stopped after {self.time_s:g} s: {' '.join(str(error).split())}") from None

    def users(self) -> Users:
        """Return all road users that are on the roads now."""
        vehicle, person = self.sumo.vehicle, self.sumo.person
        names = list(vehicle.getIDList())
        rows = [(*vehicle.getPosition(name), vehicle.getAngle(name), vehicle.getSpeed(name)) for name in names]
        walking = [name for name in person.getIDList() if not person.getVehicle(name)]
        rows += [(*person.getPosition(name), person.getAngle(name), person.getSpeed(name)) for name in walking]
        kinds = [self._kind(vehicle, name) for name in names]
        kinds += [self._number[person.getTypeID(name)] for name in walking]
        kind = np.array(kinds, np.int64)
        x, y, angle, speed = np.array(rows, np.float64).reshape(-1, 4).T
        heading, velocity = heading_and_velocity(angle, speed)
        ahead = np.column_stack([exact.cos(heading), exact.sin(heading)])
        place = np.column_stack([x, y]) - 0.5 * self.size[kind, :1] * ahead
        there = (np.abs(x) < _NOWHERE_M) & (self.label[kind] != LEFT_OUT)
        walkers = [f"person {name}" for name in walking]  # a vehicle may have the same name
        return Users(tuple(names + walkers), kind, place, heading, velocity)[np.flatnonzero(there)]

    def _kind(self, vehicle: Any, name: str) -> int:
        if name not in self._kind_of:
            self._kind_of[name] = self._number[vehicle.getTypeID(name)]
        return self._kind_of[name]

    def drive(self, accelerations: Mapping[str, float], step_s: float, standing: Set[str]) -> None:
        """Give vehicles their speed after the next step, by accelerations, m/s², whatever is before them.

        Those in `standing` stand.
        """
        vehicle = self.sumo.vehicle
        for name in sorted({*accelerations, *standing} & {*vehicle.getIDList()}):
            speed_m_s = max(vehicle.getSpeed(name) + step_s * accelerations.get(name, 0.0), 0.0)
            vehicle.setSpeedMode(name, _ALL_CHECKS_OFF)
            vehicle.setSpeed(name, 0.0 if name in standing else speed_m_s)

    def touching(self) -> list[tuple[str, str]]:
        """Return pairs of road users that touch each other now."""
        return [(each.collider, each.victim) for each in self.sumo.simulation.getCollisions()]


def _library() -> Any:
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints a warning about pyarrow, of which it uses nothing
            return importlib.import_module("libsumo")
    except ImportError as error:
        raise MissingDependencyError(
            f"traffic=\"sumo\" needs libsumo, which does not load here ({error}): pip install 'coopsim[sumo]'"
        ) from None


@contextlib.contextmanager
def _told_to(file: Path) -> Iterator[None]:
    """Write to a file what the library says of errors, which it writes to the process's."""
    with file.open("wb") as written:
        before = os.dup(2)
        os.dup2(written.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)


def _file(given: Path | str, written: Path) -> Path:
    """Return a file, which is written if its content is given."""
    if isinstance(given, Path):
        return given
    written.write_text(given, encoding="utf-8")
    return written


def _name(given: Path | str) -> str:
    return str(given) if isinstance(given, Path) else "the network of the place"


def step_for(dt_s: float) -> float:
    """Return the longest step of whole milliseconds, at most `LONGEST_STEP_S`, that divides the time between frames.

    Raises:
        InvalidValueError: the time between frames is not of whole milliseconds.
    """
    whole = round(1000 * dt_s)
    if whole < 1 or abs(1000 * dt_s - whole) > 1e-6:
        raise InvalidValueError(
            f'dt_s must be of whole milliseconds with traffic="sumo", as SUMO\'s time is, got {dt_s}'
        )
    return max(step for step in range(1, round(1000 * LONGEST_STEP_S) + 1) if whole % step == 0) / 1000
