"""Drive in places of maps without sensing, and print a table: crashes, standstills, red lights, lanes that were left.

    python scripts/drive_maps.py Town05.xodr.gz cologne8.net.xml --places 20 --seconds 300 --vehicles 40

A vehicle is off its lane farther aside than half the lane's width. It runs a red light where its middle passes a stop
line whose light has been red for a second. A standstill counts from 120 s on.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from tabulate import tabulate
from tqdm import tqdm

from coopsim.errors import CoopsimError
from coopsim.world.drawn_places import choose_scenarios
from coopsim.world.places.signals import RED
from coopsim.world.scenario import Scenario
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.world import World

STEP_S, JAM_S, RED_S = 0.1, 120.0, 1.0
LOOP_M = 35.0  # from the ends of lanes at the circle to the far side of loops to turn round in


def drive(scenario: Scenario, seed: int, seconds: float, radius_m: float, told: list[str]) -> Counter[str]:
    """Drive an episode; return numbers of what must not happen. `told` gets a line for each crash and standstill."""
    world, layout = World(scenario, seed), scenario.layout
    traffic: Any = world._traffic
    network = NumberedNetwork(layout.network)
    lanes = [layout.network.get_lane(index) for index in network.lane_index]
    lit = {
        network.lane_number[(*road, 0)]: (s, k)
        for s, one in enumerate(layout.signals)
        for k, road in enumerate(one.roads)
    }
    found, stood_s, before, red_s = Counter[str](), np.zeros(0), np.zeros(0), dict.fromkeys(lit, 0.0)
    crashed, off, seen = set[int](), set[int](), set[int]()
    for _ in range(round(seconds / STEP_S)):
        states = traffic.light_states
        for lane, (s, k) in lit.items():
            red_s[lane] = red_s[lane] + STEP_S if states[s][k] == RED else 0.0
        world.step(STEP_S)
        rows = traffic.fleet.rows
        moving = rows["driver"] != PARKED
        if not len(stood_s):
            stood_s, before = np.zeros(len(rows)), rows["target_lane"].copy()
        stood_s = np.where((rows["speed"] < 0.1) & moving, stood_s + STEP_S, 0.0)
        for n in np.flatnonzero((stood_s >= JAM_S) & (stood_s < JAM_S + STEP_S)).tolist():
            found["standstills"] += not rows["crashed"][n]
            told.append(f"stands {_where(rows[n], network)}")
        for n in np.flatnonzero((rows["target_lane"] != before) & moving).tolist():
            found["red lights run"] += red_s.get(int(rows["target_lane"][n]), 0.0) > RED_S
        before = rows["target_lane"].copy()
        for n in np.flatnonzero(rows["crashed"]).tolist():
            if int(rows["id"][n]) not in crashed:
                crashed.add(int(rows["id"][n]))
                told.append(f"crash {_where(rows[n], network)}")
        for n in np.flatnonzero(moving).tolist():
            lane = lanes[rows["target_lane"][n]]
            along, aside = lane.local_coordinates(np.array([rows["x"][n], rows["y"][n]]))
            if abs(aside) > lane.width / 2 and 0 <= along <= lane.length:
                off.add(int(rows["id"][n]))
        seen |= set(rows["id"][moving].tolist())
        out = np.hypot(rows["x"], rows["y"])[list(traffic.connected)] > radius_m + LOOP_M
        found["connected cars outside"] = max(found["connected cars outside"], int(out.sum()))
    found["crashed vehicles"], found["vehicles off their lane"] = len(crashed), len(off)
    found["vehicles"] = int(moving.sum())
    found["that came in"] = len(seen) - int(moving.sum())
    return found


def _where(row: Any, network: NumberedNetwork) -> str:
    start, end, _ = network.lane_index[row["target_lane"]]
    return f"({row['x']:.1f}, {row['y']:.1f}) {row['length']:.1f} m long on {start} -> {end}"


def survey(path: str, options: argparse.Namespace) -> dict[str, Any]:
    """Drive the places of a map; return its row."""
    total, errors, told, made_s, driven_s = Counter[str](), Counter[str](), list[str](), list[float](), 0.0
    for place in tqdm(range(options.places), desc=Path(path).name):
        began_s = process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                asked = {name: value for name in ("vehicles", "demand") if (value := getattr(options, name))}
                scenarios = choose_scenarios(
                    path, detail="plain", place_seed=place, radius_m=options.radius_m, connected_cars=3, **asked
                )
                scenario = scenarios.of(place)
        except CoopsimError as error:
            errors[str(error)[:300]] += 1
            continue
        made_s.append(process_time() - began_s)
        lines: list[str] = []
        began_s = process_time()
        total += drive(scenario, place, options.seconds, options.radius_m, lines)
        driven_s += process_time() - began_s
        told += [f"place {place}: {line}" for line in lines]
    for line in told if options.tell else ():
        print(line)
    for error, count in errors.items():
        print(f"{path}: {count} x {error}")
    step_ms = 1e3 * driven_s * STEP_S / max(options.seconds * len(made_s), 1.0)
    ms = {"ms to make": round(1e3 * float(np.median(made_s or [0.0]))), "ms a step": round(step_ms, 2)}
    return {"map": Path(path).name, "places": len(made_s), **total, **ms}


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("maps", nargs="+")
    add("--places", type=int, default=20)
    add("--seconds", type=float, default=300.0)
    add("--vehicles", type=int, default=40)
    add("--radius-m", type=float, default=250.0)
    add("--demand", help="file of SUMO's demand for the maps (.rou.xml)")
    add("--tell", action="store_true", help="also print where vehicles crashed or stood")
    options = parser.parse_args()
    rows = [survey(path, options) for path in options.maps]
    heads = list(dict.fromkeys(key for row in rows for key in row))
    print(tabulate([[row.get(key, 0) for key in heads] for row in rows], heads, tablefmt="github"))


if __name__ == "__main__":
    main()
