"""Drive every scenario's traffic for an hour, without sensing: `python scripts/drive_for_hours.py --seeds 4`.

Prints a table: crashes, numbers of actors, longest standstill, speed, and memory.
"""

import argparse
import resource
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial
from multiprocessing import Pool
from time import perf_counter
from typing import Any

import numpy as np
import yaml

from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.world.population import Population
from coopsim.world.scenario import SCENARIOS, Scenario, make_scenario
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.world import World

COUNTS = [field.name for field in fields(Population)]
DT_S = 0.1
STANDING_M_S = 0.1
COLUMNS = (
    "scenario",
    "seed",
    "crashed vehicles",
    "first at (s)",
    "actors, least",
    "actors, mean",
    "longest standstill (s)",
    "speed, first 10 min (m/s)",
    "speed, last 10 min (m/s)",
    "memory grew by (MB)",
    "took (s)",
)


@dataclass
class Diary:
    """Statistics of one episode, frame by frame; vehicles may leave and be replaced, with new ids."""

    world: World
    crashed: dict[int, float]
    actors: list[int]
    speeds: list[float]
    standing_s: dict[int, float]
    longest_s: float = 0.0

    def note(self, time_s: float, *, loud: bool) -> None:
        """Add the present state of the world."""
        rows = self.world.fleet.rows
        for row in rows[rows["crashed"]]:
            if row["id"] not in self.crashed and loud:
                print(f"  {time_s:.1f} s: {self.world.models[row['model']].name} crashed at", _place(row), flush=True)
            self.crashed.setdefault(int(row["id"]), time_s)
        drives = (rows["driver"] != PARKED) & ~rows["crashed"]
        still = rows["id"][drives & (np.abs(rows["speed"]) < STANDING_M_S)].tolist()
        self.standing_s = {k: self.standing_s.get(k, 0.0) + DT_S for k in still}
        self.longest_s = max([self.longest_s, *self.standing_s.values()])
        self.actors.append(len(self.world.actors()))
        self.speeds.append(float(rows["speed"][rows["driver"] != PARKED].mean()))


def _place(row: np.void) -> str:
    return f"({row['x']:.1f}, {row['y']:.1f}) m, heading {np.degrees(row['heading']):.0f} degrees"


def drive(name_seed: tuple[str, int], *, minutes: float, loud: bool, numbers: dict[str, Any]) -> list[str]:
    """Drive one episode; return a row of the table."""
    name, seed = name_seed
    world = World(_scenario(name, numbers), seed)
    diary, began_s, grown_mb = Diary(world, {}, [], [], {}), perf_counter(), 0.0
    steps = round(minutes * 60 / DT_S)
    for step in range(steps):
        world.step(DT_S)
        diary.note((step + 1) * DT_S, loud=loud)
        if step == steps // 6:
            grown_mb = -_memory_mb()
    part = max(1, steps // 6)
    return [
        name,
        str(seed),
        str(len(diary.crashed)),
        f"{min(diary.crashed.values()):.0f}" if diary.crashed else "",
        str(min(diary.actors)),
        f"{np.mean(diary.actors):.1f}",
        f"{diary.longest_s:.0f}",
        f"{np.mean(diary.speeds[:part]):.1f}",
        f"{np.mean(diary.speeds[-part:]):.1f}",
        f"{grown_mb + _memory_mb():.1f}",
        f"{perf_counter() - began_s:.0f}",
    ]


def _scenario(name: str, numbers: dict[str, Any]) -> Scenario:
    """Make a registered scenario, or one from a file."""
    if not name.endswith(".yaml"):
        return make_scenario(name, **numbers)
    file = load_scenario_file(name)
    return make_scenario(file.scenario, **{key: file.keywords[key] for key in file.keywords if key in COUNTS} | numbers)


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def rows_of(arguments: argparse.Namespace) -> Iterator[list[str]]:
    """Yield a row for every scenario and seed, as they finish."""
    jobs = [
        (name, seed) for name in arguments.scenarios for seed in range(arguments.seed, arguments.seed + arguments.seeds)
    ]
    job = partial(drive, minutes=arguments.minutes, loud=arguments.loud, numbers=arguments.numbers)
    with Pool(arguments.workers, maxtasksperchild=1) as pool:
        yield from pool.imap(job, jobs, chunksize=1)


def main() -> None:
    """Read the arguments, drive, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS.names())
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--seeds", type=int, default=1, help="number of seeds")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--loud", action="store_true", help="print crashes and their places")
    parser.add_argument("--numbers", type=yaml.safe_load, default={}, help="fields of Population: '{buses: 8}'")
    arguments = parser.parse_args()
    print("| " + " | ".join(COLUMNS) + " |")
    print("|---" * len(COLUMNS) + "|")
    for row in rows_of(arguments):
        print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
