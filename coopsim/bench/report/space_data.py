"""Data of the views in three dimensions in pages: whole numbers, deflated, as text that `space.js` reads."""

from __future__ import annotations

import base64
import html
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from coopsim.bench.films.film import Film, FilmFrame
from coopsim.bench.films.space import ANGLE_RAD, CLOUD_M, FLAT, KINDS, LENGTH_M, SCORE, Solid, SpaceFrame, short_ids
from coopsim.viz import palette
from coopsim.world.places.signals import stop_bars

SPACE_SCRIPTS = ("space_gl.js", "space_world.js", "space.js")
"""Files of the template that draw views in three dimensions."""

_LEVEL = 6  # of zlib: 9 takes three times as long for a hundredth
_NOTHING = np.zeros(0, dtype=np.int64)
_NO_ROWS = np.zeros((0, 9), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class SpaceRun:
    """A run in a view in three dimensions.

    Attributes:
        label: its name in the page.
        film: its film; points and truth may be those of another run in the same traffic.
        conflict: ids of what a driven car must not touch.
    """

    label: str
    film: Film
    conflict: Sequence[int] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SpaceView:
    """A view in three dimensions of runs, of which one is shown, or two side by side.

    Attributes:
        runs: runs, at least one; all have frames in three dimensions.
        agent: the agent that it is about at first.
        shown: number of the run that is shown at first.
        together: show two runs side by side, each with its own world; False: the world of the first.
        first: number of the first frame that is shown.
        last: number of the frame after the last one; None: all are shown.
    """

    runs: Sequence[SpaceRun]
    agent: str
    shown: int = 0
    together: bool = False
    first: int = 0
    last: int | None = None

    def data(self) -> dict[str, Any]:
        """Return plain data for JSON; equal films give equal data."""
        films = [run.film for run in self.runs]
        names = list(dict.fromkeys(name for film in films for frame in film.frames for name in frame.agents))
        part = slice(self.first, self.last)
        worlds = films if self.together else films[:1]
        return {
            "units": {"length": LENGTH_M, "cloud": CLOUD_M, "angle": ANGLE_RAD, "score": SCORE},
            "kinds": KINDS,
            "flat": len(FLAT),
            "dt_s": films[0].dt_s,
            "start_s": films[0].frames[part][0].time_ns / 1e9,
            "names": names,
            "agent": self.agent,
            "shown": self.shown,
            "together": self.together,
            "solids": [_solid(each) for each in films[0].solids],
            "bars": _bars(films[0]),
            "worlds": [[_world(frame, names) for frame in film.frames[part]] for film in worlds],
            "runs": [self._run(run, names) for run in self.runs],
        }

    def _run(self, run: SpaceRun, names: Sequence[str]) -> dict[str, Any]:
        numbers = range(len(run.film.frames))[self.first : self.last]
        known = len(run.film.arrived)
        arrived = [_links(run.film.arrived[k], names) if k < known else [] for k in numbers]
        return {
            "label": run.label,
            "conflict": list(run.conflict),
            "frames": [
                _tracks(run.film.frames[k].space, names) | {"arrived": each}
                for k, each in zip(numbers, arrived, strict=True)
            ],
        }

    def html(self) -> str:
        """Return the empty view, which the script fills; it stays hidden where nothing in three dimensions is drawn."""
        about = html.escape(f"the episode in three dimensions: {', '.join(run.label for run in self.runs)}")
        return f'<div data-space aria-label="{about}"></div>'


NOTE = """Orange is the chosen agent, blue are the others and what it knows by their messages alone: hidden cars and
people shine through houses and buses. A ring spreads where a message has just told of something. Drag to turn, with two
fingers or shift to move, pinch or Ctrl + wheel to zoom, double click to reset; keys: arrows, +, -, space."""


def space_html(view: SpaceView | None) -> str:
    """Return a view and its note as HTML, hidden until the script has filled it; empty without one."""
    return "" if view is None else f'<div class="space" hidden>{view.html()}<p class="note">{NOTE}</p></div>'


def pair_view(labels: Sequence[str], films: Sequence[Film], agent: str, first: int, last: int) -> SpaceView | None:
    """Return two films side by side in three dimensions, from a frame to before another; None: not filmed so."""
    if not all(film.solids for film in films):
        return None
    runs = [SpaceRun(label, film, _conflict(film)) for label, film in zip(labels, films, strict=True)]
    return SpaceView(runs, agent, together=True, first=first, last=last)


def _conflict(film: Film) -> list[int]:
    return [] if film.drive is None else short_ids(film.drive.drive.ids[film.drive.drive.in_conflict]).tolist()


def _deflated(*arrays: NDArray[Any]) -> str:
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    content = b"".join(packer.compress(np.ascontiguousarray(each).tobytes()) for each in arrays) + packer.flush()
    return base64.b64encode(content).decode()


def _solid(solid: Solid) -> list[Any]:
    """Return kind, numbers of vertices and faces, and both; columns of differences deflate to a third."""
    columns = np.diff(solid.vertices.T, axis=1, prepend=0).astype("<i4")
    return [solid.kind, len(solid.vertices), len(solid.faces), _deflated(columns, solid.faces.T.astype("<i4"))]


def _bars(film: Film) -> list[list[list[float]]]:
    """Return the bars (4, 3) m at stop lines, at the height of the road."""
    bars = stop_bars(film.road_map.stop_lines, palette.BAR_M)
    flat = [each.vertices[:, :3] * LENGTH_M for each in film.solids if each.kind == "road"]
    if not bars or not flat:
        return []
    road = np.concatenate(flat)
    nearest = cKDTree(road[:, :2])
    return [np.column_stack([bar, road[nearest.query(bar)[1], 2]]).round(2).tolist() for bar in bars]


def _world(frame: FilmFrame, names: Sequence[str]) -> dict[str, Any]:
    """Return bodies, truth, who saw it, and points of a frame: counts, and all of it in one deflated stream."""
    space = _space(frame)
    there = [name for name in names if name in space.bodies]
    clouds = [space.clouds.get(name, np.zeros((0, 6), np.uint8)) for name in there]
    masks = [np.packbits(space.ground[name], bitorder="little") for name in there if name in space.ground]
    saw = [np.isin(space.truth[:, 0], short_ids(space.seen.get(name, _NOTHING))).astype(np.uint8) for name in there]
    whole = [*(space.bodies[name] for name in there), space.truth]
    return {
        "agents": [
            [names.index(name), int(frame.agents[name].rides), len(c)] for name, c in zip(there, clouds, strict=True)
        ],
        "count": len(space.truth),
        "lights": frame.lights,
        "data": _deflated(*(each.astype("<i4") for each in whole), *saw, *(c.T for c in clouds), *masks),
    }


def _tracks(space: SpaceFrame | None, names: Sequence[str]) -> dict[str, Any]:
    found = {name: rows for name, rows in (space.tracks if space else {}).items() if len(rows) and name in names}
    rows = np.concatenate([_NO_ROWS, *found.values()]).astype("<i4")
    return {"tracks": [[names.index(name), len(each)] for name, each in found.items()], "data": _deflated(rows)}


def _links(arrived: Mapping[str, Iterable[str]], names: Sequence[str]) -> list[list[int]]:
    """Return receiver and sender of the messages that arrived in a frame, as numbers of agents."""
    return [
        [names.index(receiver), names.index(sender)]
        for receiver, senders in arrived.items()
        for sender in sorted(senders)
        if receiver in names and sender in names
    ]


def _space(frame: FilmFrame) -> SpaceFrame:
    assert frame.space is not None, "of a film that has solids"
    return frame.space
