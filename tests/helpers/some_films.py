"""Films that nobody shot: everything that a film can hold, in two frames."""

from __future__ import annotations

import numpy as np

from coopsim.bench.films.film import ALL, Film, FilmedDrive, FilmFrame, Place, ShownLie, to_rows
from coopsim.metrics.drive_log import Drive, ReportedTracks, WayAhead
from coopsim.world.snapshot import RoadMap

SQUARE = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 4.125]])


def rows(*places: tuple[float, float]) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    """Return a box at each place, 4.5 by 2 m."""
    return to_rows(np.arange(len(places)), np.array([[x, y, 4.5, 2.0, 0.5] for x, y in places]).reshape(-1, 5))


def film_frame(k: int) -> FilmFrame:
    """Return frame `k` with two agents, of which the second lies."""
    agents = {"cav_0": Place(0.1 + k, 1 / 3, True), "rsu_0": Place(10.0, -2.0, False)}
    points = {ALL: np.array([[k, -3], [7, 9]], np.int16), "cav_0": np.zeros((0, 2), np.int16)}
    lies = [ShownLie("rsu_0", rows((5.0, 5.0)), rows(), None if k else (1.5, 2.0))]
    truth, tracks = rows((k, 0), (8, 8)), {"cav_0": rows((k, 0.2))}
    lights, told = "rG" if k % 2 else "Gr", {"cav_0": np.array([1])}
    return FilmFrame(k * 100_000_000, agents, truth, points, tracks, lies, lights, told=told)


def some_drive(frames: int) -> Drive:
    """Return a drive past one object, which is absent at first."""
    time_s = np.arange(frames) * 0.1
    boxes = np.tile([20.0, 0.0, 4.0, 2.0, 0.0], (frames, 1, 1))
    boxes[0] = np.nan
    column = np.zeros(frames)
    return Drive(
        time_s,
        np.column_stack([time_s, column, column + 4.5, column + 2.0, column]),
        column + 1.0,
        column,
        column * np.nan,
        column > 0,
        np.array([7]),
        np.array([0]),
        np.array([True]),
        boxes,
        boxes[..., :2] * 0,
        np.zeros((frames, 1), np.int64),
        tuple(ReportedTracks(np.full((k, 5), 0.5), np.zeros(k, np.int64)) for k in range(frames)),
        tuple(WayAhead(np.arange(6).reshape(3, 2) / 2 + k, 0.5, np.full(3, 8.0)) for k in range(frames)),
    )


def some_film(frames: int = 2) -> Film:
    """Return a film with messages, lies and a drive."""
    arrived = [{"cav_0": frozenset({"rsu_0"})} for _ in range(frames + 1)]
    road_map = RoadMap((SQUARE, SQUARE + 1), (), (), (SQUARE,))
    drive = FilmedDrive("cav_0", some_drive(frames + 1), {"rsu_0": 1})
    return Film(0.1, road_map, [film_frame(k) for k in range(frames)], arrived, drive)
