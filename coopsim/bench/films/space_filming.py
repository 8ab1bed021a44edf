"""Filming in three dimensions: meshes of the place once, boxes and points in every frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from coopsim.bench.films.space import (
    CLOUD_POINTS,
    LENGTH_M,
    Solid,
    SpaceFrame,
    body_row,
    box_rows,
    ground_of,
    on_ground,
    pack_cloud,
    solids_of,
    spread,
    within_reach,
)
from coopsim.metrics.score import SEEN_BY
from coopsim.metrics.track_log import TrackLog
from coopsim.types import Ints

if TYPE_CHECKING:
    from coopsim.envs.parallel import CooperativeEnv

_BY_ITSELF = SEEN_BY.index("me")


class SpaceFilming:
    """Films an episode in three dimensions.

    Args:
        env: the environment, whose episode has begun.
        points: number of points of each agent in a frame; 0: none.
    """

    def __init__(self, env: CooperativeEnv, points: int = CLOUD_POINTS) -> None:
        self._parts, self._points = env.static, points
        self._ground = ground_of(self._parts)

    def frame(self, env: CooperativeEnv) -> SpaceFrame:
        """Return the frame that was scored last; who saw what is added by `with_seen`."""
        shown = env.bev_frame(points=False)
        clouds, ground = {}, {}
        for name, body in shown.agents.items() if self._points else ():
            row = body_row(body)
            points, origin = env.bev_frame(agent=name).points, row[:3].astype(np.float64) * LENGTH_M
            points = spread(points[within_reach(points, origin)], self._points)
            clouds[name], ground[name] = pack_cloud(points, origin), on_ground(points, self._ground)
        return SpaceFrame(
            {name: body_row(body) for name, body in shown.agents.items()},
            box_rows(shown.actors.id, shown.actors.boxes),
            {name: box_rows(each.id, each.boxes, each.score) for name, each in shown.tracks.items()},
            clouds,
            ground,
            {},
        )

    def solids(self, frames: Sequence[SpaceFrame]) -> tuple[Solid, ...]:
        """Return the meshes of the place about the agents' ways in some frames."""
        places = [row[:2] * LENGTH_M for frame in frames for row in frame.bodies.values()]
        return solids_of(self._parts, np.array(places).reshape(-1, 2))


def seen_in(logs: Mapping[str, TrackLog], frames: int) -> list[dict[str, Ints]]:
    """Return the ids of the objects that each agent's own LiDAR saw, for each of the first frames of logs."""
    seen: list[dict[str, Ints]] = [{} for _ in range(frames)]
    for name, log in logs.items():
        flat = log.flat()
        by_itself = flat.truth_seen_by == _BY_ITSELF
        for frame in range(min(frames, len(log))):
            rows = slice(flat.truth_start[frame], flat.truth_start[frame + 1])
            seen[frame][name] = flat.truth_id[rows][by_itself[rows]]
    return seen
