"""The file of a recorded episode: all actors and agents in every frame, to the last bit, without sensor data.

| part | content |
|---|---|
| start | `MAGIC`; format version, length and CRC-32 of the header (unsigned 32-bit integers, little-endian) |
| header | JSON: the fields of `EpisodeHeader`; deflated in version 2, which is written where the place is described, |
| | in full detail or drawn |
| frames | each: number, actors, agents, payload's length and CRC-32 of all this (such integers); payload |

A frame is a row of 64-bit words: `ACTOR_WORDS` for each actor, `AGENT_WORDS` for each agent; floats by their bits. Its
payload holds how far each word differs from its linear continuation of the two frames before (second differences of the
bits as integers, so without rounding): all lowest bytes, all second bytes, and so on, deflated. Frames are appended
whole, so an interrupt costs at most the last one.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import CoopsimError, InvalidValueError, RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.support.checks import require_positive
from coopsim.support.files import require_writable
from coopsim.support.rng import require_seed
from coopsim.version import __version__
from coopsim.world.snapshot import Actors, AgentBody

MAGIC = b"coopsim episode\n"
PLAIN_VERSION, DESCRIBED_VERSION = 1, 2
"""Format versions; what older versions of coopsim can read is written as the first."""

ACTOR_WORDS = 19
"""Id, label, model, colour (3), accent (3) as integers; box (7), velocity (2), phase as floats."""

AGENT_WORDS = 12
"""The rows of the 3 x 4 matrix `world_SE3_base`, as floats."""

_START, _FRAME = struct.Struct("<3I"), struct.Struct("<5I")
_INTEGERS = 9
_DESCRIBED: Mapping[str, Any] = {"detail": "plain", "description": None, "place_seed": None}
"""Fields of the header that version 1 lacks, and their values then."""

_LARGEST_HEADER = 2**26

_MOST_ACTORS = 100_000
"""Far more than any place has room for: a frame of them takes 15 MB."""

_ACCEPTED = "accepted: a file that `coopsim record` or the option `record` wrote"

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class EpisodeAgent:
    """The constant part of an agent; see `AgentBody`."""

    name: str
    kind: Literal["cav", "rsu", "drone"]
    actor_id: int | None
    height_m: float


@dataclass(frozen=True, slots=True)
class EpisodeHeader:
    """The constant part of an episode.

    Attributes:
        scenario: name of the place.
        population: the scenario's numbers, by name.
        seed: the episode's.
        dt_s: time between two frames.
        agents: in the environment's order.
        models: length, width and height (m) by name, in the order that actors' `model` indexes.
        coopsim: version that recorded it.
        place: checksum of the static meshes; None: unknown.
        detail: the scenario's, which decides models and meshes.
        description: the place as in a scenario file; None: it is built in, or (in version 1) unknown.
        place_seed: seed that the place was drawn from; None: it was not drawn.
    """

    scenario: str
    population: Mapping[str, Any]
    seed: int
    dt_s: float
    agents: tuple[EpisodeAgent, ...]
    models: Mapping[str, tuple[float, ...]]
    coopsim: str = __version__
    place: int | None = None
    detail: str = "plain"
    description: Mapping[str, Any] | None = None
    place_seed: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.population, Mapping):
            raise InvalidValueError(f"population must be numbers by name, got {self.population!r}")
        if not (self.description is None or isinstance(self.description, Mapping)):
            raise InvalidValueError(f"description must be that of a place or None, got {self.description!r}")
        require_seed(self.seed)
        require_positive(dt_s=self.dt_s)


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeFrame:
    """All actors and agents at one moment, in the world frame."""

    actors: Actors
    agents: Mapping[str, AgentBody]


SUFFIXES = (".coopsim", ".rec", "")
"""Ends of the names of recordings that are written; any name is read."""


def require_recording(path: Path) -> None:
    """Raise `InvalidValueError` unless a recording can be written to a path, whose suffix is no other format's."""
    if path.suffix.lower() not in SUFFIXES:
        raise InvalidValueError(
            f"a recording is coopsim's own binary format: its name must end in .coopsim, .rec or nothing, got {path}"
        )
    require_writable(path)


class EpisodeWriter:
    """Writes an episode: begins a file, replacing an older one, and appends frames.

    No file is kept open, so none needs to be closed.

    Raises:
        InvalidValueError: the file cannot be written, or the path is not one.
    """

    def __init__(self, path: str | Path, header: EpisodeHeader) -> None:
        if not isinstance(path, (str, Path)):
            raise InvalidValueError(f"path must be that of a file to write, got {path!r}")
        self.path = Path(path)
        require_recording(self.path)
        self._coder, self._frames = _Predictor(), 0
        self._write("wb", MAGIC + _header_bytes(header))

    def append(self, actors: Actors, agents: Mapping[str, AgentBody]) -> None:
        """Append a frame; agents in the header's order."""
        words = np.concatenate([_actor_words(actors), _agent_words(agents)])
        payload = zlib.compress(_shuffled(self._coder.encode(words)))
        place = (self._frames, len(actors), len(agents), len(payload))
        self._write("r+b", _FRAME.pack(*place, _checksum(place, payload)) + payload)
        self._frames += 1

    def _write(self, mode: str, data: bytes) -> None:
        try:
            # Unbuffered, so that an interrupt leaves whole frames. Not "ab", which would create a lost file anew.
            with open(self.path, mode, buffering=0) as file:
                file.seek(0, 2)
                file.write(data)
        except OSError as error:
            raise InvalidValueError(f"cannot write {self.path}: {error.strerror}") from error


class Episode:
    """A recorded episode, fully checked when it is opened.

    Attributes:
        path: the file.
        header: constant part.
        frames: number of moments; between them are `frames - 1` steps.
        most_actors: in any frame.
        size_bytes: size of the file.

    Raises:
        InvalidValueError: the path is not one.
        RecordingError: the file is missing, not a recording, of another format version, truncated or damaged.
    """

    def __init__(self, path: str | Path) -> None:
        if not isinstance(path, (str, Path)):
            raise InvalidValueError(f"path must be the file of a recorded episode, got {path!r}; {_ACCEPTED}")
        self.path = Path(path)
        try:
            self._data = self.path.read_bytes()
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror}; {_ACCEPTED}") from error
        self.size_bytes = len(self._data)
        self.header, at = self._read_header()
        self._frames = tuple(self._scan(at))
        self.frames = len(self._frames)
        if not self.frames:
            raise RecordingError(f"{path} holds no frame: its recording was interrupted before the first")
        self.most_actors = max(actors for _, actors in self._frames)

    def __iter__(self) -> Iterator[EpisodeFrame]:
        """Yield the frames in order.

        Raises:
            RecordingError: a frame has invalid content.
        """
        coder, agents = _Predictor(), len(self.header.agents)
        for number, (payload, actors) in enumerate(self._frames):
            try:
                rows = coder.decode(_unshuffled(payload, actors * ACTOR_WORDS + agents * AGENT_WORDS))
                yield self._frame(rows[: actors * ACTOR_WORDS], rows[actors * ACTOR_WORDS :])
            except (CoopsimError, ValueError, zlib.error) as error:
                raise RecordingError(f"{self.path} is damaged in frame {number}: {error}") from error

    def _read_header(self) -> tuple[EpisodeHeader, int]:
        """Return the header, and the offset of the frames."""
        if not self._data.startswith(MAGIC):
            raise RecordingError(f"{self.path} is no recorded episode; {_ACCEPTED}")
        at = len(MAGIC) + _START.size
        if self.size_bytes < at:
            raise RecordingError(f"{self.path} is cut off in its header; {_ACCEPTED}")
        version, length, checksum = _START.unpack_from(self._data, len(MAGIC))
        if version not in (PLAIN_VERSION, DESCRIBED_VERSION):
            raise RecordingError(
                f"{self.path} has format version {version}, which coopsim {__version__} cannot read; "
                f"accepted: versions {PLAIN_VERSION} and {DESCRIBED_VERSION}. Record it again from its scenario and "
                "seed"
            )
        text = self._data[at : at + length]
        if len(text) < length or zlib.crc32(text) != checksum:
            raise RecordingError(f"{self.path} is cut off or damaged in its header; {_ACCEPTED}")
        try:
            content = json.loads(_inflated(text) if version == DESCRIBED_VERSION else text)
            content["agents"] = tuple(EpisodeAgent(**agent) for agent in content["agents"])
            content["models"] = {name: tuple(size_m) for name, size_m in content["models"].items()}
            return EpisodeHeader(**content), at + length
        except (AttributeError, KeyError, TypeError, ValueError, RecursionError, zlib.error) as error:
            raise RecordingError(f"{self.path} has an invalid header: {error}") from error

    def _scan(self, at: int) -> Iterator[tuple[bytes, int]]:
        """Yield payload and number of actors of every frame."""
        number = 0
        while at < self.size_bytes:
            head = self._data[at : at + _FRAME.size]
            whole = len(head) == _FRAME.size
            stated, actors, agents, length, checksum = _FRAME.unpack(head) if whole else (0, 0, 0, 0, 0)
            payload = self._data[at + _FRAME.size : at + _FRAME.size + length]
            if not whole or len(payload) < length:
                raise RecordingError(f"{self.path} is cut off in frame {number}, {number} whole ones come before it")
            right = _checksum((stated, actors, agents, length), payload) == checksum
            if not right or stated != number or agents != len(self.header.agents) or actors > _MOST_ACTORS:
                raise RecordingError(f"{self.path} is damaged in frame {number}, {number} whole ones come before it")
            yield payload, actors
            at, number = at + _FRAME.size + length, number + 1

    def _frame(self, actor_words: Words, agent_words: Words) -> EpisodeFrame:
        rows = actor_words.reshape(-1, ACTOR_WORDS)
        integers = rows[:, :_INTEGERS].view(np.int64)
        floats = rows[:, _INTEGERS:].view(np.float64)
        # Copies in the world's memory layout: with other strides, products may differ in the last bit.
        center, size, yaw, velocity, phase = (
            floats[:, part].copy() for part in (np.s_[:3], np.s_[3:6], 6, np.s_[7:9], 9)
        )
        label, model = integers[:, 1], integers[:, 2]
        if not ((model >= 0) & (model < len(self.header.models))).all():
            raise InvalidValueError(f"an actor's model is not one of {len(self.header.models)}")
        color, accent = (integers[:, k : k + 3].astype(np.uint8) for k in (3, 6))
        boxes = Boxes3D(center, size, yaw)
        boxes.validate("actors")
        actors = Actors(integers[:, 0], boxes, velocity, label, model, color, accent, phase)
        poses = agent_words.view(np.float64).reshape(-1, 3, 4)
        bodies = {
            agent.name: AgentBody(
                agent.name, agent.kind, agent.actor_id, SE3(pose[:, :3].copy(), pose[:, 3].copy()), agent.height_m
            )
            for agent, pose in zip(self.header.agents, poses, strict=True)
        }
        return EpisodeFrame(actors, bodies)


class _Predictor:
    """Linear prediction of each word from the two frames before; starts afresh when their number changes."""

    def __init__(self) -> None:
        self._last, self._step = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.uint64)

    def encode(self, words: Words) -> Words:
        """Return the prediction errors, with small ones of either sign as small numbers."""
        missed = (words - self._expected(len(words))).view(np.int64)
        self._learn(words)
        return ((missed << 1) ^ (missed >> 63)).view(np.uint64)

    def decode(self, coded: Words) -> Words:
        """Return the words that `encode` was given."""
        one = np.uint64(1)
        missed = (coded >> one) ^ (~(coded & one) + one)
        words = missed + self._expected(len(coded))
        self._learn(words)
        return words

    def _expected(self, count: int) -> Words:
        if count != len(self._last):
            self._last = self._step = np.zeros(count, dtype=np.uint64)
        return self._last + self._step

    def _learn(self, words: Words) -> None:
        self._last, self._step = words, words - self._last


def _header_bytes(header: EpisodeHeader) -> bytes:
    """Return version, length and checksum of the header, and itself."""
    content = {each.name: getattr(header, each.name) for each in fields(header)}
    content["agents"] = [asdict(agent) for agent in header.agents]
    described = [name for name in _DESCRIBED if content[name] != _DESCRIBED[name]]
    content = {name: value for name, value in content.items() if described or name not in _DESCRIBED}
    text = json.dumps(content, default=_plain).encode()
    if described:
        text = zlib.compress(text)
    return _START.pack(DESCRIBED_VERSION if described else PLAIN_VERSION, len(text), zlib.crc32(text)) + text


def _inflated(text: bytes) -> bytes:
    """Inflate a header, but no more than a place can need, whatever a malicious one inflates to."""
    return zlib.decompressobj().decompress(text, _LARGEST_HEADER)


def _plain(value: Any) -> int | float:
    """Return a numpy number, which users may give for a population, as a JSON number."""
    if not isinstance(value, np.number):
        raise InvalidValueError(f"a header must be of numbers and text, got {value!r}")
    number: int | float = value.item()
    return number


def _actor_words(actors: Actors) -> Words:
    integers = np.column_stack([actors.id, actors.label, actors.model, actors.color, actors.accent]).astype(np.int64)
    floats = np.column_stack([actors.boxes.array, actors.velocity, actors.phase])
    return np.hstack([integers.view(np.uint64), floats.view(np.uint64)]).ravel()


def _agent_words(agents: Mapping[str, AgentBody]) -> Words:
    poses = [body.world_SE3_base for body in agents.values()]
    matrices = [np.column_stack([pose.rotation, pose.translation]).ravel() for pose in poses]
    return np.concatenate([np.zeros(0), *matrices]).view(np.uint64)


def _shuffled(words: Words) -> bytes:
    """Return the first bytes of all words, then the second ones, and so on: similar bytes side by side."""
    return words.astype("<u8").view(np.uint8).reshape(-1, 8).T.tobytes()


def _unshuffled(payload: bytes, count: int) -> Words:
    inflater = zlib.decompressobj()
    data = inflater.decompress(payload, 8 * count + 1)  # limits what a malicious payload inflates to
    if len(data) != 8 * count or not inflater.eof:
        raise ValueError(f"its payload is not of {8 * count} bytes")
    shuffled = np.frombuffer(data, dtype=np.uint8).reshape(8, -1).T
    return np.ascontiguousarray(shuffled).reshape(-1).view("<u8").astype(np.uint64)


def _checksum(place: tuple[int, int, int, int], payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(struct.pack("<4I", *place)))
