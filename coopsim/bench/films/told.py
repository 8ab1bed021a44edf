"""Knowledge from messages alone: what an agent tracks and does not see itself, but who told it of late saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from coopsim.bench.films.film import BOX_M, TURN_RAD, FilmFrame, Rows
from coopsim.bench.films.space import short_ids
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.viz.false_tracks import BESIDE_M, apart_m

MEMORY_S = 1.0
"""Time for which trackers keep what they no longer see; views in three dimensions have it, too."""

_NOTHING, _NOBODY = np.zeros(0, dtype=np.int64), 0
_BY_MIDDLES = 1e-3  # weight of the distance of middles: of bodies that overlap a track, the nearest one counts


def with_told(
    frames: Sequence[FilmFrame],
    arrived: Sequence[Mapping[str, frozenset[str]]],
    seen: Sequence[Mapping[str, Ints]],
    carriers: Mapping[str, int],
    dt_s: float,
) -> list[FilmFrame]:
    """Return frames with what each agent knows by messages alone.

    That is what it tracks and does not see, but a sender saw in the last second, or is, whose message came in it.

    Args:
        frames: F frames.
        arrived: senders of the messages that reached each receiver, at least F.
        seen: ids of what each agent's own sensors saw, F.
        carriers: ids of the actors that carry agents.
        dt_s: time between frames.
    """
    memory, made = round(MEMORY_S / dt_s), []
    for k, frame in enumerate(frames):
        late, told = range(max(0, k - memory), k + 1), {}
        for agent, tracks in frame.tracks.items():
            senders = sorted(frozenset[str]().union(*(arrived[j].get(agent, ()) for j in late)))
            theirs = [seen[j][name] for j in late for name in senders if name in seen[j]]
            theirs.append(np.array([carriers[name] for name in senders if name in carriers], dtype=np.int64))
            mine = np.append(seen[k].get(agent, _NOTHING), carriers.get(agent, _NOBODY))
            known = np.intersect1d(tracked_ids(frame.truth, tracks), short_ids(np.concatenate(theirs)))
            ids = np.setdiff1d(known, short_ids(mine))
            if len(ids):
                told[agent] = ids
        made.append(replace(frame, told=told))
    return made


def tracked_ids(truth: Rows, tracks: Rows) -> Ints:
    """Return the ids (K,) of the objects that tracks are on or beside, the nearest one of each."""
    if not len(truth) or not len(tracks):
        return np.zeros(0, dtype=np.int64)
    bodies, places = _footprints(truth), _footprints(tracks)
    apart = apart_m(places, bodies)
    middles = np.hypot(*np.moveaxis(places[:, None, :2] - bodies[None, :, :2], -1, 0))
    nearest = np.argmin(apart + _BY_MIDDLES * middles, axis=1)
    near = apart[np.arange(len(tracks)), nearest] <= BESIDE_M
    found: Ints = truth[nearest[near], 0].astype(np.int64)
    return found


def _footprints(rows: Rows) -> Floats:
    return np.column_stack([rows[:, 1:5] * BOX_M, rows[:, 5] * TURN_RAD])
