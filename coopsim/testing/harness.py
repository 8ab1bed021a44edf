"""Harness of the conformance checks: frames of a small environment, and rules that several checks share."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

import coopsim
from coopsim.catalog import parallel_env
from coopsim.detection.detector import SensorNeeds
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.episode import run_episode
from coopsim.types import AgentSpec, CameraImage, Detections, Observation, SensorView, Sweep, Tracks

SMALL: Mapping[str, Any] = {"vehicles": 10, "lidar_columns": 256, "lidar": "VLP-16"}
"""Options of the small environment."""


Episode = Sequence[Mapping[str, Any]]
"""Parts of each frame, by agent."""

Alike = Callable[[Any, Any], str]


@dataclass(frozen=True)
class SensorFrames:
    """The frames of one short episode.

    Attributes:
        views: sensor data of each frame, by agent.
        oracles: truth of each frame, by agent.
        detections: detections of each frame by `SimulatedDetector`, by agent.
    """

    specs: Mapping[str, AgentSpec]
    views: tuple[Mapping[str, SensorView], ...]
    oracles: tuple[Mapping[str, Oracle], ...]
    detections: tuple[Mapping[str, Detections], ...]

    def without_content(self) -> SensorFrames:
        """Return one frame in which nothing is around: no points, black images, no actors, no detections."""
        views = {name: _emptied(view) for name, view in self.views[0].items()}
        oracles = {
            name: replace(oracle, actors=oracle.actors[:0], returns=oracle.returns[:0])
            for name, oracle in self.oracles[0].items()
        }
        return SensorFrames(self.specs, (views,), (oracles,), (dict.fromkeys(views, Detections.empty()),))


class _Recorder(OracleDetector):
    """A simulated detector that records its inputs and outputs."""

    def __init__(self) -> None:
        self.specs: Mapping[str, AgentSpec] = {}
        self.notes: list[tuple[SensorView, Oracle, Detections]] = []

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> _Recorder:
        self.specs, self.notes = specs, []
        return self

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        detections = SimulatedDetector().detect(view, oracle, rng)
        self.notes.append((view, oracle, detections))
        return detections


def sensor_frames(needs: SensorNeeds, frames: int, seed: int, options: Mapping[str, Any]) -> SensorFrames:
    """Simulate a few frames with the sensors that there must be; a LiDAR is there anyway. `options` come first."""
    recorder = _Recorder()
    cameras = {"cameras": "front", "renderer": "raycast"} if needs.cameras else {}
    run_small({"uplink": "none", **cameras, **options, "detector": recorder}, frames, seed)
    count = len(recorder.specs)
    notes = [recorder.notes[k : k + count] for k in range(0, len(recorder.notes), count)]
    return SensorFrames(
        recorder.specs,
        tuple({view.agent: view for view, _, _ in frame} for frame in notes),
        tuple({view.agent: oracle for view, oracle, _ in frame} for frame in notes),
        tuple({view.agent: found for view, _, found in frame} for frame in notes),
    )


class Idle(coopsim.Policy):
    """A policy that hears nobody and reports nothing."""

    needs = coopsim.Needs(uplink="none")

    def track(self, agent: str, observation: Observation) -> Tracks:
        return Tracks.empty()


def run_small(options: Mapping[str, Any], frames: int, seed: int) -> Mapping[str, AgentSpec]:
    """Run the small environment for a few frames, in which nothing is reported. Return its agents."""
    with closing(parallel_env("crossing", **{**SMALL, **options, "max_cycles": frames})) as env:
        run_episode(env, Idle(), seed=seed, most_steps=frames - 1)
    return env.agent_specs


def name_of(part: object) -> str:
    """Return the name of a part under check, for messages: its spec, or that of its class or function."""
    return part if isinstance(part, str) else getattr(part, "__name__", type(part).__name__)


@contextmanager
def untouched(given: object, rule: str) -> Iterator[None]:
    """Check that a block leaves nested data as they are."""
    before = digest(given)
    yield
    assert digest(given) == before, rule


def require_same(first: Episode, other: Episode, rule: str, alike: Alike) -> None:
    """Check that two episodes have the same parts in every frame; `alike` says why two parts differ, or nothing."""
    for number, (one, two) in enumerate(zip(first, other, strict=True)):
        assert one.keys() == two.keys(), f"{rule}: agents differ in frame {number}"
        for agent in one:
            differs = alike(one[agent], two[agent])
            assert not differs, f"{rule}: {differs} of {agent} differ in frame {number}"


def digest(value: object) -> str:
    """Return a digest of all arrays and numbers in nested dataclasses and mappings, to find out what changed."""
    parts: list[bytes] = []
    _add_bytes(value, parts)
    return hashlib.sha256(b"\x00".join(parts)).hexdigest()


def _add_bytes(value: object, parts: list[bytes]) -> None:
    """Add the bytes of nested data to a list: one for all, as a check takes most of its time here."""
    kind = type(value)
    if kind is float or kind is int or kind is str:  # most of all
        parts.append(repr(value).encode())
    elif isinstance(value, np.ndarray):
        parts.append(str(value.shape).encode() + value.tobytes())
    elif isinstance(value, list | tuple):
        parts.append(str(len(value)).encode())
        for each in value:
            _add_bytes(each, parts)
    elif isinstance(value, Mapping):
        for key, each in value.items():
            parts.append(str(key).encode())
            _add_bytes(each, parts)
    elif is_dataclass(value):
        for field in fields(value):
            _add_bytes(getattr(value, field.name), parts)
    else:
        parts.append(repr(value).encode())


def _emptied(view: SensorView) -> SensorView:
    images = {
        name: CameraImage(
            None if image.rgb is None else np.zeros_like(image.rgb),
            None if image.depth is None else np.zeros_like(image.depth),
        )
        for name, image in view.images.items()
    }
    return replace(view, sweeps=dict.fromkeys(view.sweeps, Sweep.empty()), images=images)


T = TypeVar("T")
Case = TypeVar("Case")
Answers = TypeVar("Answers")


def require_own_state(
    make: Callable[[], T], run: Callable[[T, Case], Answers], cases: Sequence[Case], name: str, words: tuple[str, str]
) -> Answers:
    """Require that new objects answer a case alike, whatever other objects did before. Return the last case's answers.

    Args:
        make: makes an object.
        run: lets an object answer a case.
        cases: two cases or more.
        name: name of the part, for messages.
        words: noun for a case, and for the users of objects, such as "drive" and "cars".
    """
    made, (case_word, users) = make(), words
    for case in cases:
        first, again = (run(make(), case) for _ in range(2))
        assert first == again, f"{name} must return the same for the same {case_word}"
    later = make()
    run(made, cases[-2])
    assert run(later, cases[-1]) == first, f"{name} must share no state between two {users} or episodes"
    return first
