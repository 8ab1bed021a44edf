"""Filming: a recorder that makes the film of a run while it goes on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from coopsim.bench.films.film import ALL, Film, FilmedDrive, FilmFrame
from coopsim.bench.films.space import Solid
from coopsim.bench.films.space_filming import SpaceFilming, seen_in
from coopsim.bench.films.told import with_told
from coopsim.episode import Episode, Recorder
from coopsim.geometry.se3 import Floats
from coopsim.metrics.track_log import TrackLog
from coopsim.world.snapshot import RoadMap

POINTS, CAR_POINTS = 500, 700
"""Points that a frame keeps of all agents together or of one, and of a driven car."""


class Filming(Recorder):
    """Films a run: points of all agents together, or where cars are driven those of each, with its messages and drive.

    Args:
        points: number of points of a frame; 0: none.
        of_each: film the points and messages of each agent, too.
        space: number of points of each agent in three dimensions; 0: boxes alone; None: the film is from above alone.
    """

    def __init__(self, points: int = POINTS, *, of_each: bool = False, space: int | None = None) -> None:
        self._points, self._of_each, self._cloud = points, of_each, space
        self.frames: list[FilmFrame] = []
        self._arrived: list[Mapping[str, frozenset[str]]] = []
        self._delivered: dict[tuple[str, str], int] = {}
        self._drive: FilmedDrive | None = None
        self._dt_s, self._map = 0.0, RoadMap((), (), (), ())
        self._space: SpaceFilming | None = None
        self._logs: Mapping[str, TrackLog] = {}
        self._carriers: dict[str, int] = {}

    def begin(self, episode: Episode) -> None:
        env = episode.env
        self._cars = list(env.cars)
        self._receivers = self._cars or (list(episode.frame.agents) if self._of_each else [])
        self._dt_s, self._map = next(iter(env.agent_specs.values())).dt_s, env.road_map
        self._space = None if self._cloud is None else SpaceFilming(env, self._cloud)
        self._noted = self._cars if self._cars and self._space is None else list(episode.frame.agents)

    def on_step(self, episode: Episode) -> None:
        env = episode.env
        clouds = dict.fromkeys(self._receivers, CAR_POINTS if self._cars else self._points)
        clouds |= {} if self._cars else {ALL: self._points}
        points = {
            name: thinned(env.bev_frame(agent=name or None).points, count) for name, count in clouds.items() if count
        }
        seen = env.bev_frame(points=False)
        self._carriers |= {name: each.actor_id for name, each in seen.agents.items() if each.actor_id is not None}
        shown = FilmFrame.of(seen, points)
        space = None if self._space is None else self._space.frame(env)
        self.frames.append(replace(shown, lights=env.road_map.lights, space=space))
        self._logs = env.logs
        self._note_arrivals({link: each.delivered for link, each in env.link_counts.items()})
        if self._cars and not env.agents:
            self._drive = FilmedDrive.of(self._cars[0], env.records["drives"][self._cars[0]].drive, env.logs)

    def _note_arrivals(self, delivered: dict[tuple[str, str], int]) -> None:
        if not self._arrived:  # the first call comes after two frames, and each has one message of a sender
            self._arrived.append(self._senders(link for link, count in delivered.items() if count > 1))
        new = (link for link, count in delivered.items() if count > self._delivered.get(link, 0))
        self._arrived.append(self._senders(new))
        self._delivered = delivered

    def _senders(self, links: Iterable[tuple[str, str]]) -> dict[str, frozenset[str]]:
        found = dict[str, list[str]]()
        for sender, receiver in links:
            found.setdefault(receiver, []).append(sender)
        return {name: frozenset(found[name]) for name in self._noted if name in found}

    @property
    def film(self) -> Film:
        """The film so far."""
        seen, solids = seen_in(self._logs, len(self.frames)), tuple[Solid, ...]()
        frames = with_told(self.frames, self._arrived, seen, self._carriers, self._dt_s)
        if self._space is not None and frames:
            spaces = [each.space for each in frames if each.space is not None]
            spaces = [replace(space, seen=ids) for space, ids in zip(spaces, seen, strict=True)]
            frames = [replace(frame, space=space) for frame, space in zip(frames, spaces, strict=True)]
            solids = self._space.solids(spaces)
        return Film(self._dt_s, self._map, frames, self._arrived, self._drive, solids)


def thinned(points: Floats, count: int) -> Floats:
    """Return about `count` of the points (N, 3): every n-th in the order of the sweep, which runs around the sensor."""
    stride = max(1, -(-len(points) // count))
    return points[::stride]
