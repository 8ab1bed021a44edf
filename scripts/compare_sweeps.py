"""Compare simulated sweeps with real ones by statistics that a detector depends on.

    python scripts/compare_sweeps.py REAL [--clips 12] [--figure docs/results/sweeps.png] [--recipe RECIPE]

REAL is a folder of real sweeps, one `.npz` a frame, with `points` (N, 5): x, y, z m (z = 0 on the ground), intensity,
age; labelled ones have `boxes` (M, 7), `names` (M,) and `returns` (M,). Prints a table in Markdown with a column for
each real sensor and, beside it, for simulated sweeps of that sensor: ideal ones, and realistic ones
(`realistic_share`). With a recipe, by name or path, a further column has realistic sweeps with its `world.sensors`.
A figure shows one sweep of each
from above. Frames in `ASIDE` are never read: they are for tests of networks.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from coopsim.config.load import load
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import AgentScene, Scene
from coopsim.learn.clips.sensor_ranges import SensorRanges
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world import ClipWorld, draw_world
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.recipe import find_recipe
from coopsim.sensors.lidar.patterns import find_pattern
from coopsim.types.taxonomy import ObjectClass

ASIDE = ("av2_7fab_1",)
BANDS_DEG = ((-25, -15), (-15, -8), (-8, -4), (-4, -2), (-2, 0), (0, 2))
"""Elevations over which rays are counted."""

RANGES_M = ((0, 15), (15, 30), (30, 50))
CELL_M, CLUSTER_M = 2.4, 0.4
VEHICLE_NAMES = ("car", "van", "truck", "regular_vehicle", "box_truck", "large_vehicle", "bus")
PERSON_NAMES = ("pedestrian",)
VEHICLES = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS)
PEOPLE = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)


@dataclass(frozen=True, slots=True)
class Sensor:
    """LiDAR of a real data set, and the files that it made.

    Attributes:
        name: column of the table.
        files: pattern of the files' names.
        pattern: beam table of the nearest model here.
        columns: firings per revolution.
        at_m: place in the axes of the files.
    """

    name: str
    files: str
    pattern: str
    columns: int
    at_m: tuple[float, float, float]


SENSORS = (
    Sensor("KITTI, HDL-64E", "kitti_*.npz", "HDL-64E", 2083, (0.0, 0.0, 1.73)),
    # egovehicle_SE3_sensor of both units is near x = 1.35, z = 1.6 m over the axle, which is 0.35 m over the ground.
    Sensor("Argoverse 2, 2x VLP-32C", "av2_*.npz", "2x VLP-32C", 1800, (1.35, 0.0, 1.95)),
)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Sweep with its labels.

    Attributes:
        points: (N, 4) x, y, z m, z = 0 on the ground, and intensity.
        origin_m: (3,) place of the sensor.
        vehicles: (V, 7) boxes; also those hit by nothing.
        people: (P, 7) likewise.
        columns: firings per revolution.
    """

    points: Floats
    origin_m: Floats
    vehicles: Floats
    people: Floats
    columns: int


def real_frames(folder: Path, sensor: Sensor) -> Iterator[Frame]:
    """Yield the real frames of a sensor."""
    for path in sorted(folder.glob(sensor.files)):
        if path.stem in ASIDE:
            continue
        with np.load(path) as read:
            names = read["names"] if "names" in read else np.zeros(0, "U1")
            boxes = (read["boxes"] if "boxes" in read else np.zeros((0, 7))).astype(np.float64)
            vehicles, people = (boxes[np.isin(names, kinds)] for kinds in (VEHICLE_NAMES, PERSON_NAMES))
            points = read["points"][:, :4].astype(np.float64)
            yield Frame(points, np.array(sensor.at_m), vehicles, people, sensor.columns)


def simulated_frames(sensor: Sensor, clips: int, share: float, **more: Any) -> Iterator[Frame]:
    """Yield frames of cars in drawn towns, of which none is for validation or tests; `more` options of the recipe."""
    dry: dict[str, Any] = {"rain_share": 0.0, "fog_share": 0.0, "masts": (0, 0)}
    recipe = WorldRecipe(frames=1, lidars={sensor.pattern: 1.0}, realistic_share=share, **dry, **more)
    for index in range(clips):
        drawn = draw_world(recipe, 0, index)
        (scene,) = SimulatedClips(recipe).clip(index).scenes
        for agent in scene.agents:
            if agent.kind == "cav":
                yield _frame(scene, agent, drawn)


def _frame(scene: Scene, agent: AgentScene, drawn: ClipWorld) -> Frame:
    own = scene.object_id == agent.actor_id
    under_m = drawn.under_lidar_m(agent.kind, float(scene.boxes[own, 5][0]))
    origin = np.array([drawn.lidar.x_m, 0.0, under_m + drawn.lidar.above_m])
    boxes = scene.boxes[~own].copy()
    cos, sin = np.cos(agent.xyz_yaw[3]), np.sin(agent.xyz_yaw[3])
    boxes[:, :3] -= agent.xyz_yaw[:3]
    boxes[:, :2] = boxes[:, :2] @ np.array([[cos, -sin], [sin, cos]])
    boxes[:, 6] -= agent.xyz_yaw[3]
    label = scene.label[~own]
    vehicles, people = (boxes[np.isin(label, kinds)] for kinds in (VEHICLES, PEOPLE))
    return Frame(agent.points.astype(np.float64), origin, vehicles, people, drawn.lidar.columns)


def measure(frame: Frame, sensor: Sensor) -> dict[str, list[float]]:
    """Return the values of a frame by the name of the row that they are averaged in."""
    values: dict[str, list[float]] = {"points a sweep, thousands": [len(frame.points) / 1000]}
    for part in (_rays(frame, sensor), _ground(frame), measure_objects(frame, sensor), _clutter(frame)):
        values |= part
    return values


def _rays(frame: Frame, sensor: Sensor) -> dict[str, list[float]]:
    """Return the share of rays that return, by elevation."""
    away = frame.points[:, :3] - frame.origin_m
    elevation = np.degrees(np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])))
    beams = np.degrees(find_pattern(sensor.pattern).elevation_rad)
    shares = {}
    for low, high in BANDS_DEG:
        rays = ((beams >= low) & (beams < high)).sum() * frame.columns
        returned = ((elevation >= low) & (elevation < high)).sum()
        shares[f"returns of rays at {low} to {high} degrees, %"] = [100 * returned / rays] if rays else []
    return shares


def _ground(frame: Frame) -> dict[str, list[float]]:
    """Return unevenness and brightness of the ground within 30 m.

    The ground is what lies within 0.2 m of the tenth percentile of the heights in its cell of 2.4 m.
    """
    points = frame.points[np.hypot(frame.points[:, 0], frame.points[:, 1]) < RANGES_M[1][1]]
    key = np.floor(points[:, :2] / CELL_M).astype(int)
    _, cell = np.unique(key, axis=0, return_inverse=True)
    order = np.argsort(cell.reshape(-1), kind="stable")
    runs = np.split(order, np.flatnonzero(np.diff(cell.reshape(-1)[order])) + 1)
    lows, within, found = [], [], []
    for run in runs:
        low = np.percentile(points[run, 2], 10)
        on = run[np.abs(points[run, 2] - low) < 0.2]
        if len(on) < 10 or abs(low) > 1.0:
            continue
        found.append(on)
        lows.append([*points[on, :2].mean(axis=0), low])
        flat = np.column_stack([points[on, :2], np.ones(len(on))])
        within.append(np.std(points[on, 2] - flat @ np.linalg.lstsq(flat, points[on, 2], rcond=None)[0]))
    low = np.array(lows)
    plane = np.column_stack([low[:, :2], np.ones(len(low))])
    tilt = np.linalg.lstsq(plane, low[:, 2], rcond=None)[0]
    ground = points[np.concatenate(found)]
    rows = {
        "ground: slope of the plane, %": [100 * float(np.hypot(*tilt[:2]))],
        "ground: rms about the plane, cm": [100 * float(np.std(low[:, 2] - plane @ tilt))],
        "ground: rms within 2.4 m, cm": [100 * float(np.median(within))],
    }
    away = np.hypot(ground[:, 0], ground[:, 1])
    for low_m, high_m in ((3, 8), (8, 15), (15, 30)):
        bright = ground[(away >= low_m) & (away < high_m), 3]
        rows[f"intensity of the ground at {low_m} to {high_m} m, median"] = [float(np.median(bright))]
    return rows


def measure_objects(frame: Frame, sensor: Sensor) -> dict[str, list[float]]:
    """Return returns, brightness and outlines of vehicles and people."""
    rows: dict[str, list[float]] = {}
    for kind, boxes in (("vehicle", frame.vehicles), ("person", frame.people)):
        inside = [points_in(frame.points, box) for box in boxes]
        away = np.hypot(boxes[:, 0], boxes[:, 1])
        for low_m, high_m in RANGES_M:
            near = [k for k in np.flatnonzero((away >= low_m) & (away < high_m)) if len(inside[k])]
            where = f"{low_m} to {high_m} m"
            rows[f"returns of a {kind} at {where}"] = [float(len(inside[k])) for k in near]
            rows[f"share of the rays over its box that a {kind} returns at {where}, %"] = [
                100 * len(inside[k]) / rays_over(boxes[k], frame, sensor) for k in near
            ]
        seen = [k for k in range(len(boxes)) if len(inside[k]) >= 10 and away[k] < 50]
        rows[f"intensity of a {kind}, median"] = [float(np.median(inside[k][:, 3])) for k in seen]
        rows[f"points of a {kind} more than 0.2 m inside its box, %"] = [
            100 * float((depth_in(inside[k], boxes[k]) > 0.2).mean()) for k in seen
        ]
        rows[f"middle height of a {kind}'s points, share of its own"] = [
            float(np.mean((inside[k][:, 2] - boxes[k, 2]) / boxes[k, 5] + 0.5)) for k in seen
        ]
    return rows


def points_in(points: Floats, box: Floats, margin_m: float = 0.1) -> Floats:
    """Return the points (N, 4) in a box (7,), but for those within 0.15 m of its bottom."""
    near = points[np.abs(points[:, :2] - box[:2]).max(axis=1) < np.hypot(box[3], box[4])]
    local = _turned(near, box)
    low, high = box[2] - box[5] / 2 + 0.15, box[2] + box[5] / 2 + margin_m
    beside = (np.abs(local) < box[3:5] / 2 + margin_m).all(axis=1)
    inside: Floats = near[beside & (near[:, 2] > low) & (near[:, 2] < high)]
    return inside


def depth_in(points: Floats, box: Floats) -> Floats:
    """Return the distance (N,) of points from the nearest side or the top of a box, m; negative outside."""
    sides = box[3:5] / 2 - np.abs(_turned(points, box))
    depth: Floats = np.minimum(sides.min(axis=1), box[2] + box[5] / 2 - points[:, 2])
    return depth


def _turned(points: Floats, box: Floats) -> Floats:
    cos, sin = np.cos(box[6]), np.sin(box[6])
    turned: Floats = (points[:, :2] - box[:2]) @ np.array([[cos, -sin], [sin, cos]])
    return turned


def rays_over(box: Floats, frame: Frame, sensor: Sensor) -> float:
    """Return the number of rays through the rectangle that a box shows to the sensor, but for its lowest 0.15 m."""
    away = box[:3] - frame.origin_m
    distance = float(np.hypot(away[0], away[1]))
    aside = np.arctan2(away[1], away[0]) - box[6]
    width = box[3] * abs(np.sin(aside)) + box[4] * abs(np.cos(aside))
    low, high = (np.arctan2(away[2] + up, distance) for up in (0.15 - box[5] / 2, box[5] / 2))
    beams = find_pattern(sensor.pattern).elevation_rad
    turn = 2 * float(np.arctan2(width / 2, distance)) / (2 * np.pi)
    return max(float(((beams >= low) & (beams <= high)).sum()), 1.0) * max(turn * frame.columns, 1.0)


def _clutter(frame: Frame) -> dict[str, list[float]]:
    """Return the numbers of clusters within 30 m, by size, of what stands 0.4 to 2.5 m over the ground of its cell."""
    points = frame.points[np.hypot(frame.points[:, 0], frame.points[:, 1]) < RANGES_M[1][1]]
    reach = RANGES_M[1][1]
    coarse = np.floor((points[:, :2] + reach) / CELL_M).astype(int)
    lowest = np.full((int(2 * reach / CELL_M) + 2,) * 2, np.inf)
    np.minimum.at(lowest, tuple(coarse.T), points[:, 2])
    up = points[:, 2] - lowest[tuple(coarse.T)]
    points, up = points[(up > 0.4) & (up < 2.5)], up[(up > 0.4) & (up < 2.5)]
    fine = np.floor((points[:, :2] + reach) / CLUSTER_M).astype(int)
    filled = np.zeros((int(2 * reach / CLUSTER_M) + 2,) * 2, bool)
    filled[tuple(fine.T)] = True
    label, count = ndimage.label(filled, np.ones((3, 3)))
    sizes = np.array([max(s.stop - s.start for s in each) for each in ndimage.find_objects(label)])
    height = ndimage.maximum(up, label[tuple(fine.T)], np.arange(1, count + 1)) if count else np.zeros(0)
    small = sizes <= 3
    return {
        "clusters a frame, at most 1.2 m wide, over 1.5 m high": [float((small & (height > 1.5)).sum())],
        "clusters a frame, at most 1.2 m wide, lower": [float((small & (height <= 1.5)).sum())],
        "clusters a frame, 1.2 to 6 m": [float(((sizes > 3) & (sizes <= 15)).sum())],
        "clusters a frame, wider": [float((sizes > 15).sum())],
    }


@dataclass(slots=True)
class Column:
    """Values of all frames of one source, by row."""

    name: str
    values: dict[str, list[float]] = field(default_factory=dict)
    frames: int = 0

    def add(self, measured: dict[str, list[float]]) -> None:
        """Add the values of a frame."""
        self.frames += 1
        for name, values in measured.items():
            self.values.setdefault(name, []).extend(values)


def sources_of(
    folder: Path, sensor: Sensor, clips: int, ranges: SensorRanges | None = None
) -> dict[str, Iterator[Frame]]:
    """Return the frames of a real sensor, and of simulated ones, by the name of their column."""
    by_recipe = {} if ranges is None else {"by recipe": simulated_frames(sensor, clips, 1.0, sensors=ranges)}
    return {
        sensor.name: real_frames(folder, sensor),
        "ideal": simulated_frames(sensor, clips, 0.0),
        "realistic": simulated_frames(sensor, clips, 1.0),
        **by_recipe,
    }


def columns_of(folder: Path, clips: int, ranges: SensorRanges | None) -> list[Column]:
    """Return real, ideal and realistic columns of each sensor, and one with `ranges`, if any."""
    columns = []
    for sensor in SENSORS:
        for name, frames in sources_of(folder, sensor, clips, ranges).items():
            column = Column(name)
            for frame in frames:
                column.add(measure(frame, sensor))
            columns.append(column)
    return columns


def draw(folder: Path, path: Path) -> None:
    """Draw the first real, ideal and realistic sweep of each sensor from above, coloured by height."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(len(SENSORS), 3, figsize=(12, 8.2), constrained_layout=True)
    for row, sensor in zip(axes, SENSORS, strict=True):
        for axis, (name, frames) in zip(row, sources_of(folder, sensor, 1).items(), strict=True):
            frame = next(frames)
            near = frame.points[np.abs(frame.points[:, :2]).max(axis=1) < RANGES_M[1][1]]
            axis.scatter(*near[:, :2].T, c=near[:, 2], s=0.15, vmin=-0.3, vmax=2.5, cmap="viridis", linewidths=0)
            for box in np.concatenate([frame.vehicles, frame.people]):
                axis.plot(*_outline(box).T, color="crimson", linewidth=0.7)
            axis.set(title=name, aspect="equal", xlim=(-30, 30), ylim=(-30, 30), xticks=[], yticks=[])
    figure.savefig(path, dpi=90)


def _outline(box: Floats) -> Floats:
    """Return the outline (5, 2) of a box (7,) from above."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) * box[3:5] / 2
    outline: Floats = box[:2] + corners @ np.array([[cos, sin], [-sin, cos]])
    return outline


def table(columns: Sequence[Column]) -> str:
    """Return a table in Markdown: medians over all values, and how many these are."""
    names = list(dict.fromkeys(name for column in columns for name in column.values))
    lines = ["|  | " + " | ".join(column.name for column in columns) + " |", "|" + " -- |" * (len(columns) + 1)]
    lines.append("| frames | " + " | ".join(str(column.frames) for column in columns) + " |")
    for name in names:
        cells = [_cell(column.values.get(name, [])) for column in columns]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(values: Sequence[float]) -> str:
    return f"{np.median(values):.3g} ({len(values)})" if len(values) else ""


def main() -> None:
    """Print the table, and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("real", type=Path, help="folder of real sweeps")
    parser.add_argument("--clips", type=int, default=12, help="simulated clips of each kind")
    parser.add_argument("--figure", type=Path, help="picture to draw")
    parser.add_argument("--recipe", help="adds a column with its world.sensors")
    given = parser.parse_args()
    ranges = None if given.recipe is None else load(WorldRecipe, find_recipe(given.recipe).world, "world").sensors
    if given.figure is not None:
        draw(given.real, given.figure)
    print(table(columns_of(given.real, given.clips, ranges)))


if __name__ == "__main__":
    main()
