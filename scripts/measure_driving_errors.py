"""Measure what wrong poses, liars and told intents change on the road, in paired situations.

    coopsim bench --preset safety --out safety
    python scripts/measure_driving_errors.py poses --results safety/results.csv --out poses.jsonl
    python scripts/measure_driving_errors.py planners --results safety/results.csv --out planners.jsonl
    python scripts/measure_driving_errors.py liars --results safety/results.csv --out liars.jsonl
    python scripts/measure_driving_errors.py intents --seeds 1000 1010 --out intents.jsonl

The first three drive the episodes of the preset in which messages avoid a crash, so an error can only bring crashes
back; `intents` drives situations with all seeds. Only the driven car tracks (`late_fusion(delayed=replay)`); the
others send. Runs that the file has are not made again. Printed is a table of all cases with the change from the first
of each group, with 95 % intervals (Wilson's for crashes, Newcombe's for their differences, else a bootstrap's).
"""

from __future__ import annotations

import argparse
import csv
import json
import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import coopsim
from coopsim.bench.results.statistics import rate_interval
from coopsim.bench.safety.paired import compare_runs
from coopsim.comms.codecs.maneuvers import DENM_ID
from coopsim.localization import localizer
from coopsim.localization.pose_noise import PoseError, PoseNoise
from coopsim.metrics.drive_events import find_events
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

EGO = "cav_0"
MEETINGS = ("merge_barrier", "left_turn_across", "crossing_path")
POLICY = "late_fusion(delayed=replay)"
CALM = {"latency_s": 0.0, "loss": 0.0, "position_noise_m": 0.0, "heading_noise_deg": 0.0, "penetration": 0.3}
METRICS = ("crash", "hard_brakes", "phantom_brakes", "time_lost")
TIGHT = "idm_aeb(gap_m=0.2, margin_m=0.02, margin_s=0.02)"
Options = dict[str, Any]


class OneError(PoseError):
    """Errors of the pose that are the same for all agents."""

    def __init__(self, noise: PoseNoise, seed: int, agent: str, dt_s: float) -> None:
        super().__init__(noise, seed, "all", dt_s)


def white(size: float) -> Options:
    """Return options for errors that are new in each frame, of so many metres and degrees."""
    return {"position_noise_m": size, "heading_noise_rad": math.radians(size)}


def lasting(metres: float, degrees: float) -> Options:
    """Return options for errors that stay for an episode."""
    pose = PoseNoise(position_bias_m=metres, heading_bias_rad=math.radians(degrees))
    return {"localization": localizer.LocalizationConfig(pose=pose)}


def intent_cases() -> Iterator[tuple[str, str, Options]]:
    """Yield group, name and options of each case: what is told, by latency."""
    uplinks = {"detections": "detections", "and intents": "intents(hard_brakes=False)", "and DENM": "intents"}
    for latency_s in (0.0, 0.1, 0.3, 0.5):
        for name, uplink in uplinks.items():
            if name == "and DENM" and latency_s != 0.3:
                continue  # all runs were the same as without
            yield f"{latency_s:g} s", name, {"uplink": uplink, "latency_s": latency_s, "penetration": 1.0}


def pose_cases() -> Iterator[tuple[str, str, Options]]:
    """Yield cases of errors by size, kind and part."""
    yield "poses", "none", {}
    for size in (0.5, 1, 2, 4):
        yield "poses", f"lasting, {size:g} m, {size:g} degrees", lasting(size, size)
    for size in (0.5, 2, 4):
        yield "poses", f"new each frame, {size:g} m, {size:g} degrees", white(size)
    yield "poses", "lasting, 4 m, 0 degrees", lasting(4, 0)
    yield "poses", "lasting, 0 m, 4 degrees", lasting(0, 4)
    yield "poses", "lasting, 4 m, 4 degrees, one for all", lasting(4, 4) | {"one_error": True}


def planner_cases() -> Iterator[tuple[str, str, Options]]:
    """Yield cases of planners under lasting errors."""
    for planner in (TIGHT, "route_follower", "cautious"):
        for size in (0, 0.5, 2):
            yield planner, f"lasting, {size:g} m, {size:g} degrees", lasting(size, size) | {"planner": planner}


def liar_cases() -> Iterator[tuple[str, str, Options]]:
    """Yield cases of lies of one sender, or of all."""
    yield "lies", "nobody lies", {}
    for attack in ("remove", "shift(aside_m=3)", "shift(aside_m=1)"):
        for liars in ("one", "all"):
            yield "lies", f"{attack}, {liars}", {"liars": liars, "attack": attack}
    yield "lies", "nobody lies, all cars connected", {"penetration": 1.0}
    yield "lies", "remove, one, all cars connected", {"penetration": 1.0, "liars": "one", "attack": "remove"}


CASES = {"intents": intent_cases, "poses": pose_cases, "planners": planner_cases, "liars": liar_cases}


@cache
def environment(group: str, kind: str, name: str, situation: str) -> Any:
    """Return the environment of a case and a situation."""
    options = {"lidar": None} | {(of, each): options for of, each, options in CASES[group]()}[kind, name]
    options.pop("one_error", None)
    liars, attack = options.pop("liars", ""), options.pop("attack", "")
    if liars:
        senders = coopsim.parallel_env(situation, **options).possible_agents[1:]
        options["attacks"] = dict.fromkeys(senders if liars == "all" else senders[:1], attack)
    return coopsim.parallel_env(situation, **options)


def drive(env: Any, seed: int) -> dict[str, float]:
    """Drive an episode, and return its numbers."""
    policy, silent = coopsim.make_policy(POLICY), pack_tracks(Tracks.empty())
    env.reset(seed=seed)
    policy.reset(env.agent_specs, seed=env.policy_seed)
    warnings = 0
    while env.agents:
        heard = env.episode.received[EGO]
        warnings += sum(payload[1] == DENM_ID for payload in heard.signals)
        tracks = pack_tracks(policy.track(EGO, heard))
        env.step({name: {"tracks": tracks if name == EGO else silent} for name in env.agents})
    events = find_events(env.records["drives"][EGO].drive)
    numbers = 100.0 * (events.crash is not None), len(events.hard_s), len(events.phantom_s), events.lost_s
    sent = {"bytes": float(np.mean([env.bytes_per_s(name) for name in env.possible_agents])), "denm": warnings}
    return dict(zip(METRICS, map(float, numbers), strict=True)) | sent


def avoided(path: Path) -> list[tuple[str, int]]:
    """Return situations and seeds of the preset `safety` in which only a car alone crashes, by turns of situations."""
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if all(float(row[key] or 0) == each for key, each in CALM.items())]
    crashed = {(row["policy"], row["scenario"], int(row["seed"])): float(row["crash"]) > 0 for row in rows}
    found = sorted(key[1:] for key, crash in crashed.items() if key[0] == "no_fusion" and crash)
    found = [key for key in found if crashed.get((POLICY, *key)) is False]
    turn = {key: sum(other[0] == key[0] and other < key for other in found) for key in found}
    return sorted(found, key=lambda key: (turn[key], key))


def measure(group: str, out: Path, worlds: Sequence[tuple[str, int]]) -> None:
    """Make the runs of a group of cases that a file lacks, and add them to it."""
    known = {tuple(row[:4]) for row in rows_of(out)}
    for situation, seed in worlds:
        for kind, name, options in CASES[group]():
            if (kind, name, situation, seed) in known:
                continue
            localizer.PoseError = OneError if "one_error" in options else PoseError  # type: ignore[misc]
            numbers = drive(environment(group, kind, name, situation), seed)
            with out.open("a") as file:
                file.write(json.dumps([kind, name, situation, seed, numbers]) + "\n")


def rows_of(path: Path) -> list[Any]:
    """Return the runs of a file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def tabulate(path: Path) -> None:
    """Print a table of the cases in a file, over the situations and seeds that all of a group have."""
    runs: dict[tuple[str, str], dict[tuple[str, int], dict[str, float]]] = {}
    for kind, name, situation, seed, numbers in rows_of(path):
        runs.setdefault((kind, name), {})[situation, seed] = numbers
    print(f"| | | pairs | {' | '.join(METRICS)} | bytes/s | DENM |\n|{' -- |' * (5 + len(METRICS))}")
    first: dict[str, str] = {}
    for kind, name in runs:
        base = runs[kind, first.setdefault(kind, name)]
        shared = sorted(set.intersection(*(set(each) for (of, _), each in runs.items() if of == kind)))
        cells = []
        for metric in METRICS:
            before, after = (np.array([each[key][metric] for key in shared]) for each in (base, runs[kind, name]))
            found = compare_runs(name, before, after, metric)
            assert found is not None
            change = found.change
            rate = rate_interval(after)
            cells.append(f"{after.mean():.2f}" + f" ({rate.low:.0f} to {rate.high:.0f})" * (metric == "crash"))
            if name != first[kind]:
                cells[-1] += f" ({change.mean:+.2f}, {change.low:.2f} to {change.high:.2f}; {found.less}, {found.more})"
        sent = [np.mean([runs[kind, name][key][what] for key in shared]) for what in ("bytes", "denm")]
        print(f"| {kind} | {name} | {len(shared)} | {' | '.join(cells)} | {sent[0]:.0f} | {sent[1]:.2f} |")


def main(argv: Sequence[str] | None = None) -> None:
    """Make the runs of a group that a file lacks, and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("group", choices=sorted(CASES))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--results", type=Path, help="results.csv of the preset, not for intents")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1010), metavar=("FIRST", "END"), help="of intents")
    parser.add_argument("--situations", nargs="+", default=MEETINGS, help="of intents")
    parser.add_argument("--most", type=int, default=None, help="number of episodes for each case")
    options = parser.parse_args(argv)
    worlds = [(each, seed) for seed in range(*options.seeds) for each in options.situations]
    if options.group != "intents":
        if options.results is None:
            parser.error("--results is needed: the results.csv of coopsim bench --preset safety")
        worlds = avoided(options.results)
    measure(options.group, options.out, worlds[: options.most])
    tabulate(options.out)


if __name__ == "__main__":
    main()
