"""Measure how pasted actors look beside real objects, and what doubts about a sweep cover.

    python scripts/measure_pasting.py REAL [--copies 4] [--actors 12]

REAL is a folder as for `compare_sweeps.py`. Prints two tables in Markdown. The first has statistics of labelled
vehicles and people in the real sweeps of each sensor, and of those pasted into the same sweeps. The second has, for
scores from which the shipped detector's boxes are doubtful, the labelled objects on which no cell is taught, and the
share of cells of 1.2 m within 48 m that are not: of all, and of those with points 0.5 to 2.5 m high.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from compare_sweeps import ASIDE, PERSON_NAMES, SENSORS, VEHICLE_NAMES, Column, Frame, Sensor, measure_objects, table
from tabulate import tabulate

from coopsim.geometry.se3 import Floats
from coopsim.learn.paste.object_finder import ObjectFinder
from coopsim.learn.paste.paste import PasteSettings, paste
from coopsim.learn.samples.targets import make_targets
from coopsim.types import BevGrid, Ints, Mask

SCORES = (0.3, 0.2, 0.15, 0.1)
REACH_M, LEAST_RETURNS = 48.0, 3
GRID = BevGrid((-REACH_M, REACH_M), (-REACH_M, REACH_M), 1.2)
STANDING_M = (0.5, 2.5)
PASTED_VEHICLES, PASTED_PEOPLE = ("car", "van", "truck", "bus"), ("pedestrian", "child")


def read_frame(path: Path, sensor: Sensor, vehicles: Iterable[str], people: Iterable[str]) -> Frame:
    """Read a sweep with its vehicles and people, by the names of their types."""
    with np.load(path) as read:
        boxes, names = read["boxes"].astype(np.float64), read["names"]
        points = read["points"][:, :4].astype(np.float64)
    parts = (boxes[np.isin(names, list(kinds))] for kinds in (vehicles, people))
    return Frame(points, np.array(sensor.at_m), *parts, sensor.columns)


def columns_of(folder: Path, settings: PasteSettings) -> Iterator[Column]:
    """Yield real and pasted columns of each sensor."""
    for sensor in SENSORS:
        paths = [path for path in sorted(folder.glob(sensor.files)) if path.stem not in ASIDE]
        real, pasted = Column(sensor.name), Column("pasted")
        with tempfile.TemporaryDirectory() as name:
            bare, out = Path(name, "bare"), Path(name, "out")
            bare.mkdir()
            for path in paths:
                with np.load(path) as read:
                    if "boxes" in read:
                        real.add(measure_objects(read_frame(path, sensor, VEHICLE_NAMES, PERSON_NAMES), sensor))
                    np.savez(bare / path.name, points=read["points"])
            for made in paste(bare, out, settings, lambda points: np.zeros((0, 7))):
                pasted.add(measure_objects(read_frame(made.path, sensor, PASTED_VEHICLES, PASTED_PEOPLE), sensor))
        yield real
        yield pasted


def doubts_at(score: float, paths: Iterable[Path]) -> list[object]:
    """Return a row: score, covered and all vehicles and others, shares of cells that are not taught."""
    find, covered, of_all, of_standing = ObjectFinder(least_score=score), list[tuple[bool, bool]](), [], []
    for path in paths:
        with np.load(path) as read:
            points, boxes = read["points"][:, :4], read["boxes"].astype(np.float64)
            names, shown = read["names"], read["returns"] >= LEAST_RETURNS
        doubtful = find(points)
        flags = np.ones(len(doubtful), np.bool_)
        targets = make_targets(doubtful, np.zeros((len(doubtful), 2)), np.zeros(len(doubtful), np.int64), GRID, flags)
        ignored = targets.ignored[0].numpy()
        height = points[:, 2]
        standing = np.zeros_like(ignored)
        standing[cells_of(points[(height > STANDING_M[0]) & (height < STANDING_M[1])].astype(np.float64))] = True
        of_all.append(ignored.mean())
        of_standing.append(ignored[standing].mean())
        inside = shown & (np.abs(boxes[:, :2]) < REACH_M).all(axis=1)
        covered += zip(
            np.isin(names[inside], VEHICLE_NAMES).tolist(), ignored[cells_of(boxes[inside])].tolist(), strict=True
        )
    counts = [[under for is_vehicle, under in covered if is_vehicle == kind] for kind in (True, False)]
    shares = [f"{100 * np.mean(each):.0f}" for each in (of_all, of_standing)]
    return [score, *(f"{sum(each)} of {len(each)}" for each in counts), *shares]


def cells_of(places: Floats) -> tuple[Ints, Ints]:
    """Return row and column of the cells of those of places (N, 2 or more) that lie in the grid."""
    cell = np.floor((places[:, :2] + REACH_M) / GRID.cell_m).astype(np.int64)
    inside: Mask = ((cell >= 0) & (cell < GRID.shape[0])).all(axis=1)
    return cell[inside, 1], cell[inside, 0]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("real", type=Path, help="folder of real sweeps")
    parser.add_argument("--copies", type=int, default=4, help="of each sweep (default: 4)")
    parser.add_argument("--actors", type=int, default=12, help="drawn for each (default: 12)")
    given = parser.parse_args()
    settings = PasteSettings(actors=(given.actors, given.actors), copies=given.copies)
    print(table(list(columns_of(given.real, settings))))
    labelled = []
    for path in sorted(given.real.glob("*.npz")):
        with np.load(path) as read:
            labelled += [path] if "boxes" in read and path.stem not in ASIDE else []
    headers = ("score", "vehicles covered", "others covered", "cells, %", "cells with standing points, %")
    rows = [doubts_at(score, labelled) for score in SCORES]
    print("\n" + tabulate(rows, headers, tablefmt="github", disable_numparse=True))


if __name__ == "__main__":
    main()
