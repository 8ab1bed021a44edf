"""Measure what stands over and beside labelled objects, in real sweeps, in drawn towns and in their streets.

    python scripts/measure_streets.py REAL [--clips 12]

REAL is a folder of real sweeps, as of `compare_sweeps.py`, whose sensors, frames and boxes these are. Prints a table in
Markdown of objects with at least ten returns within 50 m: shares that have returns of no vehicle or person within a
metre, over them (up to 4 m) or beside them (0.3 m over their foot, or more).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from compare_sweeps import SENSORS, Frame, points_in, real_frames, simulated_frames
from tabulate import tabulate

from coopsim.geometry.se3 import Floats

LEAST_RETURNS, WITHIN_M, AWAY_M, HIGH_M, FOOT_M = 10, 50.0, 1.0, 4.0, 0.3
ENOUGH = 20
"""Returns over or beside an object that make surroundings of it."""

ROOM_M = 0.1
"""Around boxes, in which points count as the object's."""

HEADERS = ("sweeps", "of", "objects", "a sweep", "with enough over them, %", "beside them, %")


def beyond(points: Floats, box: Floats) -> Floats:
    """Return the horizontal distance (N,) m of points (N, 4) from a box (7,); 0 inside of its outline."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    x, y = (points[:, axis] - box[axis] for axis in range(2))
    out_x, out_y = np.abs(x * cos + y * sin) - box[3] / 2, np.abs(y * cos - x * sin) - box[4] / 2
    return np.asarray(np.hypot(np.maximum(out_x, 0.0), np.maximum(out_y, 0.0)))


def of_nobody(frame: Frame) -> Floats:
    """Return the points (N, 4) of a frame that are in no box of it."""
    points = frame.points[np.hypot(frame.points[:, 0], frame.points[:, 1]) < WITHIN_M + 5.0]
    for box in np.concatenate([frame.vehicles, frame.people]):
        low, high = box[2] - box[5] / 2 - ROOM_M, box[2] + box[5] / 2 + ROOM_M
        points = points[(beyond(points, box) > ROOM_M) | (points[:, 2] < low) | (points[:, 2] > high)]
    return points


def surroundings(frame: Frame, boxes: Floats) -> list[tuple[int, int]]:
    """Return the numbers of returns over and beside each of the boxes (N, 7) that has enough returns."""
    rest, found = of_nobody(frame), []
    for box in boxes[np.hypot(boxes[:, 0], boxes[:, 1]) <= WITHIN_M]:
        if len(points_in(frame.points, box)) >= LEAST_RETURNS:
            up = rest[beyond(rest, box) <= AWAY_M, 2] - (box[2] + box[5] / 2)
            over = (up > ROOM_M) & (up < HIGH_M)
            found.append((int(over.sum()), int(((up <= ROOM_M) & (up > FOOT_M - box[5])).sum())))
    return found


def rows(name: str, frames: Iterable[Frame]) -> list[list[object]]:
    """Return the rows of a source: one for vehicles, one for people."""
    labelled = [frame for frame in frames if len(frame.vehicles) + len(frame.people)]
    table: list[list[object]] = []
    for kind in ("vehicles", "people"):
        counts = np.array([each for frame in labelled for each in surroundings(frame, getattr(frame, kind))])
        over, beside = 100 * (counts.reshape(-1, 2) >= ENOUGH).mean(axis=0) if len(counts) else (np.nan, np.nan)
        table.append([name, kind, len(counts), len(counts) / max(len(labelled), 1), over, beside])
    return table


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("real", type=Path, help="folder of real sweeps")
    parser.add_argument("--clips", type=int, default=12, help="simulated clips of each kind")
    given = parser.parse_args()
    table = [row for sensor in SENSORS for row in rows(sensor.name, real_frames(given.real, sensor))]
    sensor = SENSORS[-1]
    for name, street_share in (("drawn towns", 0.0), ("their streets", 1.0)):
        table += rows(name, simulated_frames(sensor, given.clips, 1.0, plain_share=0.0, street_share=street_share))
    print(tabulate(table, headers=HEADERS, tablefmt="github", floatfmt=".1f"))


if __name__ == "__main__":
    main()
