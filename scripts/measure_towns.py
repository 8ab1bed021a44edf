"""Measure what agents in drawn towns sense, and print it beside the labels and detections of V2V4Real.

    python scripts/measure_towns.py --places 0-39 --seconds 20 --processes 2 --v2v4real FOLDER
    python scripts/measure_towns.py --environments Town05.xodr.gz --option radius_m=150 --crews "as OPV2V"

With `--environments`, towns and places of maps stand beside each other. `--option` goes to all of them but towns.
FOLDER holds V2V4Real as recording sets `train` and `val`, each with `labels` and `detections/{ego,1}`. One frame a
second is measured; towns have the default options. A value is the mean over places of a place's mean, with the 95 %
interval of Student's t over places. Commands score policies; none looks at what agents sense.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate
from tqdm import tqdm

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.cli.argument_types import named_value, names, seeds
from coopsim.data.recording_set import RecordingSet
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_places import TOWN

Values = dict[str, float]

VEHICLES = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS, ObjectClass.MOTORCYCLE)
REGION_M, LONG_REGION_M = (100.0, 40.0), (140.0, 40.0)
"""Half the region around the first agent, ahead and aside: of V2V4Real's labels and V2X-Real's task; of OPV2V's."""

RANGES_M = (0, 20, 40, 60, 80, 100)
GRADES = (0.4, 0.6, 0.8)
"""Bounds of nuScenes' grades of visibility."""

ABOVE_GROUND_M = 0.3
LABELLED_FROM = 5
"""Returns of all agents together from which an annotator would have labelled a vehicle."""

FOUND_WITHIN_M = 2.0
"""Distance of centers below which an object counts as detected."""


@dataclass(frozen=True)
class Crew:
    """The agents of a survey: those of towns by default, or as many and with such LiDARs as a data set has."""

    name: str
    lidar: str
    numbers: tuple[tuple[str, int], ...] = ()


CREWS = (
    Crew("default", "HDL-32E"),
    Crew("as V2V4Real", "HDL-32E", (("connected_cars", 2), ("rsus", 0))),
    Crew("as OPV2V", "HDL-64E", (("connected_cars", 3), ("rsus", 0))),
    Crew("as V2X-Real", "OS1-128", (("connected_cars", 2), ("rsus", 2))),
)


def measure(job: tuple[tuple[str, Crew], int], *, seconds: int, options: Mapping[str, Any]) -> Values:
    """Measure a place; return the means over its frames."""
    (environment, crew), place = job
    env = coopsim.parallel_env(
        environment,
        place_seed=place,
        lidar=crew.lidar,
        dt_s=1.0,
        max_cycles=seconds,
        expose_ground_truth=True,
        expose_visibility=True,
        **{**dict(crew.numbers), **(options if environment != TOWN else {})},
    )
    kept = Frames()
    coopsim.run_episode(env, coopsim.make_policy("no_fusion"), [kept], seed=place)
    env.close()
    frames = kept.frames
    names = dict.fromkeys(name for frame in frames for name in frame)
    return {name: _mean([frame[name] for frame in frames]) for name in names}


class Frames(coopsim.Recorder):
    """Values of each frame after a step."""

    def __init__(self) -> None:
        self.frames: list[dict[str, float]] = []

    def on_step(self, episode: coopsim.Episode) -> None:
        self.frames.append(dict(_frame(episode.observations, episode.infos)))


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that are known, NaN if none is."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def _frame(observations: Mapping[str, Any], infos: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the values of a frame by name."""
    first = next(iter(infos))
    truth = infos[first]["ground_truth"]
    agents = [info["actor_id"] for info in infos.values()]
    other = ~np.isin(truth["id"], [agent for agent in agents if agent is not None])
    vehicle = np.isin(truth["label"], VEHICLES)
    seen_by = truth["seen_by"].sum(axis=1)
    near = (np.abs(truth["box"][:, :2]) < REGION_M).all(axis=1)
    yield "actors in the world", len(truth["id"]) + (infos[first]["actor_id"] is not None)
    yield "vehicles with returns, anywhere", (vehicle & (seen_by > 0)).sum()
    yield "people and riders with returns, anywhere", (~vehicle & (seen_by > 0)).sum()
    labelled = near & (truth["returns"].sum(axis=1) >= LABELLED_FROM)
    yield "vehicles with returns, in the region", (vehicle & near & (seen_by > 0)).sum()
    yield f"vehicles with {LABELLED_FROM} returns or more, in the region", (vehicle & labelled).sum()
    yield "people and riders with returns, in the region", (~vehicle & near & (seen_by > 0)).sum()
    near_opv2v = (np.abs(truth["box"][:, :2]) < LONG_REGION_M).all(axis=1)
    yield "vehicles with returns, in OPV2V's longer region", (vehicle & near_opv2v & (seen_by > 0)).sum()
    labels, total = vehicle & other & (seen_by > 0), truth["returns"].sum(axis=1)
    own = truth["returns"][labels, list(infos).index(first)]
    yield "vehicles with returns, anywhere, without agents", labels.sum()
    yield "of these without returns of the first agent, %", _percent(own == 0)
    yield "returns of these, all agents together, median", _median(total[labels])
    for what, count in (("one agent", seen_by == 1), ("several", seen_by > 1), ("none", seen_by == 0)):
        yield f"objects in the region with returns of {what}, %", _percent(count[near & other])
    found = np.stack([_found(truth, infos[first], observations[name], infos[name]) for name in infos], axis=1)
    counts = found.sum(axis=1)[labelled & other & vehicle]
    for what, count in (("one agent", counts == 1), ("several", counts > 1), ("none", counts == 0)):
        yield f"vehicles in the region detected by {what}, %", _percent(count)
    yield from _by_range(truth, infos)
    yield from _visibility(infos)
    height_m = np.concatenate([each["sweeps"]["lidar"][:, 2] for each in observations.values()])
    instance = np.concatenate([info["instances"]["lidar"] for info in infos.values()])
    up = (height_m > ABOVE_GROUND_M) & (instance >= 0)
    yield f"share of points over {ABOVE_GROUND_M} m that are on no object, %", _percent(instance[up] == 0)
    yield "points of a sweep", len(instance) / len(infos)


def _percent(which: NDArray[np.bool_]) -> float:
    return 100 * float(which.mean()) if len(which) else np.nan


def _median(values: NDArray[Any]) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _found(truth: Mapping[str, Any], first: Mapping[str, Any], observation: Any, info: Any) -> NDArray[np.bool_]:
    """Return which objects (N,) of the first agent's truth an agent detects."""
    at, centers = _world(first, truth["box"][:, :3]), _world(info, observation["detections"]["box"][:, :3])
    return _nearest_m(at[:, :2], centers[:, :2]) < FOUND_WITHIN_M


def _world(info: Mapping[str, Any], points: Floats) -> Floats:
    x, y, z, yaw = info["true_pose"].tolist()
    return SE3.from_xyz_yaw([x, y, z], yaw).apply(points.astype(np.float64))


def _nearest_m(points: Floats, others: Floats) -> Floats:
    """Return the distance (N,) from each of the points (N, 2) to the nearest of the others (M, 2)."""
    distances_m: Floats = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1, initial=np.inf)
    return distances_m


def _by_range(truth: Mapping[str, Any], infos: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the returns of the first agent from a car it has returns of, and the share of cars without, over range."""
    is_car = truth["label"] == ObjectClass.CAR
    range_m = np.linalg.norm(truth["box"][is_car, :2], axis=1)
    returns = truth["returns"][is_car, list(infos).index(next(iter(infos)))]
    for low_m, high_m in pairwise(RANGES_M):
        there = returns[(range_m >= low_m) & (range_m < high_m)]
        yield f"returns of a car at {low_m} to {high_m} m, median", _median(there[there > 0])
        yield f"cars at {low_m} to {high_m} m without returns, %", _percent(there == 0)


def _visibility(infos: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the shares of nuScenes' grades of visibility, and of what hides the rest."""
    seen = [info["visibility"] for info in infos.values()]
    rays, visible, occluder = (np.concatenate([each[key] for each in seen]) for key in ("rays", "visible", "occluder"))
    visible, occluder = visible[rays > 0], occluder[rays > 0]
    grade = np.digitize(visible, GRADES)
    for k, name in enumerate(("0 to 40", "40 to 60", "60 to 80", "80 to 100")):
        yield f"objects in reach of an agent of which it sees {name} %, %", _percent(grade == k)
    yield "of those below 40 %, hidden mostly by scenery, %", _percent(occluder[grade == 0] == 0)


def v2v4real(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield the values that labels and detections of a split of V2V4Real give, over all its frames."""
    recordings = RecordingSet(folder, axes="v2v4real")
    near, found = [], []
    for sequence in recordings.sequences:
        recording = recordings.load(sequence, ["ego", "1"])
        for frame, truth in enumerate(recording.truth):
            centers = truth.boxes.center[:, :2]
            near.append(int((np.abs(centers) < REGION_M).all(axis=1).sum()))
            lists = [recording.detections[name][frame].boxes.center[:, :2] for name in ("ego", "1")]
            found.append(np.stack([_nearest_m(centers, each) < FOUND_WITHIN_M for each in lists], axis=1))
    counts = np.concatenate(found).sum(axis=1)
    yield f"vehicles with {LABELLED_FROM} returns or more, in the region", float(np.mean(near))
    for what, count in (("one agent", counts == 1), ("several", counts > 1), ("none", counts == 0)):
        yield f"vehicles in the region detected by {what}, %", _percent(count)


def table(values: Mapping[tuple[str, Crew], Sequence[Values]], real: Mapping[str, Values]) -> str:
    """Return all values in Markdown."""
    every = [*(place for places in values.values() for place in places), *real.values()]
    names = dict.fromkeys(name for each in every for name in each)
    rows = []
    for name in names:
        intervals = [mean_interval(np.array([place.get(name, np.nan) for place in each])) for each in values.values()]
        shown = [f"{each.mean:.1f} ± {each.half_width:.1f}" if each.count > 1 else "" for each in intervals]
        rows.append([name, *shown, *(f"{each[name]:.1f}" if name in each else "" for each in real.values())])
    heading = ("", *(_heading(*which) for which in values), *real)
    return tabulate(rows, heading, tablefmt="github", disable_numparse=True)


def _heading(environment: str, crew: Crew) -> str:
    place = "" if environment == TOWN else f"{Path(environment).name.split('.')[0]}, "
    return f"{place}{crew.name}: {crew.lidar}"


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environments", type=names, default=(TOWN,), help="town, or files of maps (default: town)")
    parser.add_argument("--option", type=named_value, action="append", default=[], help="of places of maps")
    parser.add_argument("--crews", type=names, default=tuple(crew.name for crew in CREWS), help="(default: all)")
    parser.add_argument("--places", type=seeds, default="0-39", help="place seeds (default: 0-39)")
    parser.add_argument("--seconds", type=int, default=20, help="of each (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--v2v4real", type=Path, help="V2V4Real as a recording set")
    args = parser.parse_args()
    crews = {crew.name: crew for crew in CREWS}
    for unknown in (name for name in args.crews if name not in crews):
        parser.error(f"--crews accepts {', '.join(crews)}, got {unknown!r}")
    columns = [(environment, crews[name]) for environment in args.environments for name in args.crews]
    jobs = [(column, place) for column in columns for place in args.places]
    values: dict[tuple[str, Crew], list[Values]] = {column: [] for column in columns}
    with get_context("spawn").Pool(args.processes) as pool:
        results = pool.imap(partial(measure, seconds=args.seconds, options=dict(args.option)), jobs)
        for (column, _), measured in zip(jobs, tqdm(results, total=len(jobs)), strict=True):
            values[column].append(measured)
    splits = ("train", "val") if args.v2v4real else ()
    print(table(values, {f"V2V4Real itself, {split}": dict(v2v4real(args.v2v4real / split)) for split in splits}))


if __name__ == "__main__":
    main()
