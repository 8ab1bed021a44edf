"""Drive routes by planners, and print a table: arrivals, crashes, and how the drives went.

    python scripts/measure_planners.py --planners idm_aeb,route_follower,cautious --policies truth,late_fusion \
        --places town,Town05.xodr.gz --seeds 0-23 --out routes.jsonl

All drives of a seed have the same place, traffic and route. `idm_aeb`, which does not steer, gets pure pursuit for the
wheels. A drive ends where `coopsim/drive-v1` ends it: at the goal, at a crash, off the road, 30 m from the route, or
late. Drives that are in the file of JSON lines (--out) are not driven again. Intervals of rates are Wilson's, of 95 %.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from tabulate import tabulate
from tqdm import tqdm

import coopsim
from coopsim.bench.results.statistics import rate_interval
from coopsim.cli.argument_types import names, seeds
from coopsim.envs.parallel import CooperativeEnv
from coopsim.interfaces.planner import PlannedCar
from coopsim.planning.idm_aeb import IdmAeb
from coopsim.planning.pursuit import steering_angle
from coopsim.types import NS_PER_S
from coopsim.wire.actions import act_of
from coopsim.world.drivable_area import DrivableArea

EGO, SECONDS_PER_M, DELAY_S, DT_S = "cav_0", 0.8, 5.0, 0.1
OPTIONS = {"route_m": [200, 300], "vehicles": 20, "pedestrians": 12, "connected_cars": 3, "rsus": 1}
ENDS = ("arrive_dest", "crash", "out_of_road", "out_of_route", "max_step")
Row = dict[str, Any]


@dataclass(kw_only=True, eq=False)
class SteeredIdmAeb(IdmAeb):
    """`idm_aeb`, with wheels that follow the route."""

    steers: ClassVar[bool] = True

    def plan(self, car: PlannedCar) -> tuple[float, float]:  # type: ignore[override]  # it steers, too
        return super().plan(car), steering_angle(car)


class Watch:
    """Judge of the drive of one car."""

    def __init__(self, env: CooperativeEnv) -> None:
        self._env, self._area, self._steps = env, DrivableArea(env.road_map), 0
        self.row = Row(wrong_way_s=0.0, aside_m=0.0, hard=0, route_m=env.cars[EGO].route.length_m)

    def look(self) -> None:
        """Note what has become of the drive."""
        frame, car, row = self._env.episode.frame, self._env.cars[EGO], self.row
        self._steps += 1
        late = self._steps * DT_S >= row["route_m"] * SECONDS_PER_M + DELAY_S
        off_road = self._area.is_off_road(frame.agents[EGO].body.world_SE3_base.translation[:2])
        arrives = car.route.arrived and not car.crashed
        row["wrong_way_s"] = round(row["wrong_way_s"] + DT_S * car.wrong_way, 1)
        row["aside_m"] = round(max(row["aside_m"], math.hypot(*car.route.points[0])), 2)
        row["hard"] += car.acceleration_m_s2 < -3.0
        row |= {"red_lights": car.red_lights, "time_s": round(frame.time_ns / NS_PER_S, 1)}
        row |= dict(zip(ENDS, (arrives, car.crashed, off_road, car.route.strayed, late), strict=True))
        row |= {
            "route_completion": 1.0 if arrives else round(car.route.completion, 3),
            "over": any(row[end] for end in ENDS),
        }
        if row["over"] and not arrives:
            row["nearest"] = self._nearest()

    def _nearest(self) -> Row:
        """Return the car's speed, and the nearest other's place, speed, heading and class in the car's frame."""
        truth = self._env.episode.frame.agents[EGO].truth
        assert truth.velocity is not None
        near = int(np.argmin(np.hypot(*truth.boxes.center[:, :2].T)))
        place, speed = truth.boxes.center[near, :2].round(1).tolist(), float(np.hypot(*truth.velocity[near]))
        own = round(self._env.cars[EGO].speed_m_s, 1)
        yaw, label = round(math.degrees(truth.boxes.yaw[near])), int(truth.label[near])
        return {"own_m_s": own, "at_m": place, "m_s": round(speed, 1), "yaw_deg": yaw, "label": label}


def drive(planner: str, policy: str, place: str, seed: int, options: Row) -> Row:
    """Drive a route; return what became of it."""
    made = SteeredIdmAeb if planner == "idm_aeb" else planner
    agent = coopsim.make_policy(policy)
    env = coopsim.parallel_env(
        place, uplink=agent, control="planner", planner=made, driven_agents=(EGO,), lidar=None, dt_s=DT_S,
        max_cycles=100_000, expose_ground_truth=True, **options,
    )  # fmt: skip
    observations, infos = env.reset(seed=seed)
    agent.reset(env.agent_specs, seed=env.policy_seed)
    watch = Watch(env)
    while not watch.row.get("over"):
        observations, *_, infos = env.step(act_of(agent, observations, infos))
        watch.look()
    env.close()
    return {"planner": planner, "policy": policy, "place": Path(place).name, "seed": seed, **watch.row}


def table(rows: list[Row]) -> str:
    """Return the table of all drives, by place, policy and planner."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["place"], row["policy"], row["planner"]), []).append(row)
    lines = []
    for key, each in groups.items():
        shares = [rate_interval(np.array([100.0 * row[name] for row in each])) for name in ENDS[:2]]
        texts = [f"{one.mean:.0f} [{one.low:.0f}, {one.high:.0f}]" for one in shares]
        counts = [sum(bool(row[name]) for row in each) for name in (*ENDS[2:], "wrong_way_s", "red_lights")]
        arrived = [row for row in each if row["arrive_dest"]]
        pace = sum(row["route_m"] for row in arrived) / max(sum(row["time_s"] for row in arrived), 1e-9)
        lines.append([*key, len(each), *texts, *counts, f"{pace:.1f}", sum(row["hard"] for row in each)])
    heads = [
        "place",
        "policy",
        "planner",
        "n",
        "arrives, %",
        "crashes, %",
        "off road",
        "off route",
        "late",
        "wrong way",
    ]
    return tabulate(lines, [*heads, "red lights", "m/s", "hard"], tablefmt="pipe", disable_numparse=True)


def main() -> None:
    """Drive what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planners", type=names, default=["idm_aeb", "route_follower", "cautious"])
    parser.add_argument("--policies", type=names, default=["truth", "late_fusion"])
    parser.add_argument("--places", type=names, default=["town"])
    parser.add_argument("--seeds", type=seeds, default=range(24))
    parser.add_argument("--options", type=json.loads, default=OPTIONS, help="of the environments, JSON")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(row["planner"], row["policy"], row["place"], row["seed"]) for row in rows}
    for policy, place, seed, planner in tqdm(list(product(args.policies, args.places, args.seeds, args.planners))):
        if (planner, policy, Path(place).name, seed) in done:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rows.append(drive(planner, policy, place, seed, args.options))
        with args.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
