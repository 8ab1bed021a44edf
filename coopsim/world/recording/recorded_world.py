"""Worlds that are recorded while they are simulated, and recorded worlds that are played."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.types.driving import Command
from coopsim.version import __version__
from coopsim.world.models.model import Model
from coopsim.world.places.signals import lights_of, states
from coopsim.world.recording.episode_file import Episode, EpisodeAgent, EpisodeHeader, EpisodeWriter
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody, StaticPart, WorldSource


class RecordedWorld:
    """A world that writes each frame to a file, the present one first; its steps must all be of `dt_s`."""

    def __init__(self, world: WorldSource, path: str | Path, scenario: Scenario, seed: int, dt_s: float) -> None:
        self._world, self._dt_s = world, dt_s
        self.models, self.static, self.map = world.models, world.static, world.map
        bodies = world.agents()
        header = EpisodeHeader(
            scenario.name,
            scenario.population.numbers,
            int(seed),
            float(dt_s),
            tuple(EpisodeAgent(body.name, body.kind, body.actor_id, body.height_m) for body in bodies.values()),
            _sizes(world.models),
            place=_checksum(world.static),
            detail=scenario.detail,
            description=None if scenario.description is None else scenario.description.plain,
            place_seed=scenario.place_seed,
        )
        self._writer = EpisodeWriter(path, header)
        self._writer.append(world.actors(), bodies)

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Advance the world and record its frame."""
        if dt_s != self._dt_s:
            raise InvalidValueError(f"dt_s must be {self._dt_s}, as the recording began, got {dt_s!r}")
        self._world.step(dt_s, commands)
        self.map = self._world.map
        self._writer.append(self._world.actors(), self._world.agents())

    def actors(self) -> Actors:
        """Return the world's actors."""
        return self._world.actors()

    def agents(self) -> dict[str, AgentBody]:
        """Return the world's agents."""
        return self._world.agents()


class PlayedWorld:
    """A recorded episode, from its first frame.

    Raises:
        RecordingError: models or scenery of `scenario` differ from the recording's, or no frame is left to step to.
        InvalidValueError: a step is not of the recording's `dt_s`.
    """

    def __init__(self, episode: Episode, scenario: Scenario) -> None:
        self.models, self.static, self.map = scenario.models, scenario.static, scenario.road_map
        if list(episode.header.models.items()) != list(_sizes(self.models).items()):
            changed = _difference(episode.header.models, _sizes(self.models))
            raise RecordingError(
                f"{episode.path} was recorded (coopsim {episode.header.coopsim}) with other models than there are: "
                f"{changed}; accepted: the same models in the same order"
            )
        if episode.header.place not in (None, _checksum(self.static)):
            raise RecordingError(
                f"{episode.path} was recorded (coopsim {episode.header.coopsim}) in another {scenario.name!r} than "
                f"there is in coopsim {__version__}: what stands there has changed. Record it again from its scenario "
                "and seed"
            )
        self._episode, self._frames = episode, iter(episode)
        self._frame, self._steps, self._signals = next(self._frames), 0, scenario.layout.signals
        self._show_lights()

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Go on to the next frame; commands have no effect on a recording."""
        if dt_s != self._episode.header.dt_s:
            raise InvalidValueError(f"dt_s must be {self._episode.header.dt_s}, as it was recorded, got {dt_s!r}")
        frame = next(self._frames, None)
        if frame is None:
            raise RecordingError(f"{self._episode.path} ends after {self._episode.frames - 1} steps")
        self._frame, self._steps = frame, self._steps + 1
        self._show_lights()

    def _show_lights(self) -> None:
        """Let the map know the traffic lights, whose programs are the scenario's."""
        time_s = self._steps * self._episode.header.dt_s
        if self._signals:
            self.map = replace(self.map, lights=lights_of(self._signals, states(self._signals, time_s)))

    def actors(self) -> Actors:
        """Return the recorded actors."""
        return self._frame.actors

    def agents(self) -> dict[str, AgentBody]:
        """Return the recorded agents."""
        return dict(self._frame.agents)


def _sizes(models: tuple[Model, ...]) -> dict[str, tuple[float, ...]]:
    return {model.name: tuple(model.size_m.tolist()) for model in models}


def _checksum(static: tuple[StaticPart, ...]) -> int:
    """Return the CRC-32 of the shapes in whole millimetres, which is the same on all machines."""
    shapes = [np.round(1000.0 * part.vertices).astype("<i8").tobytes() for part in static]
    return zlib.crc32(b"".join(shapes))


def _difference(recorded: Mapping[str, tuple[float, ...]], present: Mapping[str, tuple[float, ...]]) -> str:
    """Describe the first models that differ."""
    only = [f"{name} is missing" for name in recorded if name not in present]
    only += [f"{name} is new" for name in present if name not in recorded]
    only += [f"{name} has another size" for name in recorded if present.get(name, recorded[name]) != recorded[name]]
    return ", ".join(only[:3]) or "their order"
