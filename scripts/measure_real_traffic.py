"""Measure what cars, and a roadside unit, have of each other road user before encounters in logged traffic.

    python scripts/measure_real_traffic.py RUNS --log cologne8.fcd.xml.gz --map cologne8.net.xml
    python scripts/measure_real_traffic.py RUNS --log 1.pkl
    python scripts/measure_real_traffic.py RUNS --v2v4real v2v4real/val

Casts the LiDAR of every car near, `BEFORE_S` before each encounter of a log, and appends a line of numbers of returns
to RUNS/<log>.jsonl. Lines that are there are kept, so it can be stopped and started. `plot_real_traffic.py` reads RUNS.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from detector_matches import AGENTS
from scipy.spatial import cKDTree
from tqdm import tqdm
from traffic_conflicts import find_conflicts
from twin_worlds import TwinWorld

from coopsim.data.logs.play.choice import Choice
from coopsim.data.logs.play.ground import flat_ground, map_ground
from coopsim.data.logs.play.scenarios import PlayedPart
from coopsim.data.logs.reading import read_log
from coopsim.data.logs.track_log import TrackLog
from coopsim.data.recording_set import RecordingSet
from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.scene import RayScene, SceneGeometry
from coopsim.support.rng import stream
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import AgentBody

BEFORE_S = 3.0
NEAR_M, MOVED_M = 10.0, 5.0
"""A meeting: middles come this near, while the ego drives at least this far in `BEFORE_S`."""

RADIO_M, RADIUS_M, PLACE_M = 200.0, 250.0, 60.0
"""Reach of messages, radius of what is built and played, and distance within which encounters share a place."""

SHIFTS_M = ((0.0, 0.0), (15.0, 0.0), (-15.0, 0.0), (0.0, 15.0), (0.0, -15.0))
"""Shifts of a place's middle that are tried, as some circles cut streets so that no valid place is left."""


@dataclass(frozen=True, slots=True)
class Encounter:
    """An encounter: its kind, the tracks of the ego and the other, when (s), where (m), and the number of the place."""

    kind: str
    ego: int
    other: int
    time_s: float
    at: tuple[float, float]
    place: int = 0


def conflicts(log: TrackLog) -> Iterator[Encounter]:
    """Yield both sides of each conflict, where they are cars."""
    for found in find_conflicts(log):
        for ego, other in (found.pair, found.pair[::-1]):
            yield Encounter("conflict", ego, other, found.time_s, found.place)


def meetings(log: TrackLog) -> Iterator[Encounter]:
    """Yield the first time at which each other road user comes near to each driving car."""
    met: set[tuple[int, int]] = set()
    for time_s in np.arange(log.start_s, log.end_s, 0.1).round(6).tolist():
        now = log.at(time_s)
        before = log.at(time_s - BEFORE_S)
        for pair in cKDTree(now.place[:, :2]).query_pairs(NEAR_M, output_type="ndarray").tolist():
            for row, other in (pair, pair[::-1]):
                ego, key = int(now.track[row]), (int(now.track[row]), int(now.track[other]))
                if key in met:
                    continue
                met.add(key)
                was = np.searchsorted(before.track, ego)
                if was >= len(before) or before.track[was] != ego:
                    continue
                if exact.norm(now.place[row, :2] - before.place[was, :2]) >= MOVED_M:
                    x, y = now.place[row, :2].tolist()
                    yield Encounter("meeting", *key, time_s, (x, y))


def encounters(log: TrackLog, most: int) -> tuple[list[Encounter], dict[str, int]]:
    """Return what is measured of a log, at most so many of a kind, drawn; and how many there are of each."""
    chosen: list[Encounter] = []
    counts: dict[str, int] = {}
    for name, found in (("conflict", conflicts(log)), ("meeting", meetings(log))):
        able = [each for each in found if log.label[each.ego] == ObjectClass.CAR]
        early = [each for each in able if {each.ego, each.other} <= set(log.at(each.time_s - BEFORE_S).track.tolist())]
        counts |= {name: len(able), f"{name} there {BEFORE_S:g} s before": len(early)}
        order = stream(0, f"encounters {name}").permutation(len(early))[:most]
        chosen += [early[k] for k in sorted(order.tolist())]
    return _placed(chosen), counts


def _placed(found: list[Encounter]) -> list[Encounter]:
    """Return the encounters in places: each is in the first place whose middle is near, else opens one."""
    middles: list[tuple[float, float]] = []
    placed = []
    for each in found:
        near = [k for k, middle in enumerate(middles) if np.hypot(*np.subtract(middle, each.at)) <= PLACE_M]
        if not near:
            middles.append(each.at)
        placed.append(replace(each, place=near[0] if near else len(middles) - 1))
    return sorted(placed, key=lambda each: each.place)


def sense_logs(paths: list[Path], road_map: Path | None, out: Path, most: int) -> None:
    """Append a line for each encounter of logs that has none yet, to one file."""
    out.parent.mkdir(parents=True, exist_ok=True)
    lines = out.with_suffix(".jsonl")
    known = {json.loads(line)["key"] for line in lines.read_text().splitlines()} if lines.is_file() else set()
    total: Counter[str] = Counter()
    for path in paths:
        log, source = read_log(path), path.name.split(".")[0]
        found, counts = encounters(log, most)
        total.update(counts)
        middles: dict[int, Floats] = {}
        ground, built = None, -1
        for each in tqdm(found, source):
            key = f"{source} {each.kind} {log.ids[each.ego]} {log.ids[each.other]}"
            middle = middles.setdefault(each.place, np.round(each.at))
            if key in known:
                continue
            if built != each.place:
                ground, built = _ground(log, road_map, middle, each.place), each.place
            line = {"key": key, "source": source, "kind": each.kind, "place": f"{source} {each.place}"}
            line["ego"] = f"{source} {log.ids[each.ego]}"
            if ground is not None:
                line |= _sensed(log, each, *ground)
            with lines.open("a") as file:
                file.write(json.dumps(line) + "\n")
    facts = {"log": out.name, "sources": len(paths), "map": road_map is not None, **total}
    out.with_suffix(".json").write_text(json.dumps(facts))


def write_twins(folder: Path, out: Path) -> list[Path]:
    """Write the labels of V2V4Real's recordings as logs, and return their paths; see `twin_worlds.py`."""
    recordings, paths = RecordingSet(folder, "v2v4real"), []
    out.mkdir(parents=True, exist_ok=True)
    for sequence in recordings.sequences:
        world = TwinWorld.of(recordings.load(sequence, AGENTS))
        for k, frames in enumerate(world.parts):
            paths.append(out / f"{sequence}_{k}.csv")
            world.write_log(paths[-1], frames)
    return paths


def _ground(log: TrackLog, road_map: Path | None, middle: Floats, seed: int) -> tuple[Floats, Layout] | None:
    """Return the middle of a place and what stands around it, with the roadside unit that is nearest; None: no room."""
    if road_map is None:
        return middle, flat_ground(log, RADIUS_M)
    for shift in SHIFTS_M:
        try:
            layout = map_ground(str(road_map), middle + shift, RADIUS_M, seed)
        except InvalidValueError as error:
            print(f"place {seed}: {error}")
            continue
        nearest = sorted(layout.rsus, key=lambda unit: float(exact.norm(unit.translation[:2] + shift)))[:1]
        return middle + shift, replace(layout, rsus=tuple(nearest))
    return None


def _sensed(log: TrackLog, each: Encounter, middle: Floats, layout: Layout) -> dict[str, Any]:
    """Return what each car has of the other, `BEFORE_S` before an encounter: its number of returns."""
    time_s = each.time_s - BEFORE_S
    part = log.played(time_s - log.step_s, time_s + log.step_s)
    part = replace(part, place=part.place - [*middle, 0.0])
    part = part.of(np.unique(part.track[exact.norm(part.place[:, :2]) <= RADIUS_M]))
    now = part.at(time_s)
    part = part.of(now.track)
    number = {name: k for k, name in enumerate(part.ids)}
    ego, other = number[log.ids[each.ego]], number[log.ids[each.other]]
    now = part.at(time_s)
    reach_m = LidarConfig().max_range_m + float(part.size[other, 0])
    near = exact.norm(now.place[:, :2] - now.place[other, :2]) <= reach_m
    near[ego] = True
    heard = exact.norm(now.place[:, :2] - now.place[ego, :2]) <= RADIO_M
    cars = np.flatnonzero(near & heard & (part.label == ObjectClass.CAR) & (np.arange(len(now)) != other))
    units = Population(
        vehicles=len(cars), truck_share=0.0, connected_cars=len(cars), rsus=len(layout.rsus), pedestrians=0
    )
    left_s = np.full(len(cars), time_s)
    played = PlayedPart(Choice(part, time_s, time_s, cars, left_s, middle, log, RADIUS_M))
    world = played.world(Scenario("log", layout, units, "plain", place_seed=each.place, played=played), each.place)
    scene = RayScene(SceneGeometry(world.models, world.static).triangles(world.actors()))
    returns = {name: _returns(scene, body, other + 1) for name, body in world.agents().items()}
    got = {part.ids[car]: returns[f"cav_{k}"] for k, car in enumerate(cars.tolist())}
    return {
        "other_is_car": bool(part.label[other] == ObjectClass.CAR),
        "away_m": round(float(exact.norm(now.place[ego, :2] - now.place[other, :2])), 1),
        "own": got.pop(log.ids[each.ego], 0),
        "others": {name: count for name, count in got.items() if count},
        "other": log.ids[each.other],
        "unit": returns.get("rsu_0"),
    }


_LIDAR = Lidar(LidarConfig())


def _returns(scene: RayScene, body: AgentBody, actor_id: int) -> int:
    rng = stream(0, "returns", body.name)
    sweep = _LIDAR.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)
    return int((sweep.instance == actor_id).sum())


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--log", type=Path, help="a log of traffic")
    parser.add_argument("--v2v4real", type=Path, help="or a split of V2V4Real as a recording set")
    parser.add_argument("--map", type=Path, help="a map in the log's plane; none: flat ground, without a unit")
    parser.add_argument("--name", help="of the log in tables (default: its file's)")
    parser.add_argument("--most", type=int, default=300, help="encounters of a kind (default: %(default)s)")
    given = parser.parse_args()
    if given.v2v4real is not None:
        sense_logs(write_twins(given.v2v4real, given.runs / "twins"), None, given.runs / "v2v4real", given.most)
    if given.log is not None:
        sense_logs([given.log], given.map, given.runs / (given.name or given.log.name.split(".")[0]), given.most)


if __name__ == "__main__":
    main()
