"""Measure lies that aim at the brakes: what they make a driven car do that its honest twin does not, by defence.

`python scripts/measure_brake_lies.py --out FOLDER [--seeds 4000-4011] [--plan core,attacks,defences,planners]` runs
paired episodes, keeps each in a file of the folder, and goes on where it stopped; `--table` prints what is there.

A lie succeeds if the car brakes hard at a time, within a second, at which its honest twin does not, or crashes where
the twin does not. `nudge` is the control: a constant error of 0.3 m of the stated pose, as honest agents have.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import coopsim
from coopsim.bench.results.statistics import mean_interval, rate_interval
from coopsim.episode import RECORDERS, Recorder
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.interfaces.defense import LEAST_TRUST, Defense, Reception, Trust, make_defense
from coopsim.interfaces.guard import ASKED
from coopsim.metrics.drive_events import find_events

SITUATIONS = ("parking_street", "occluded_crossing")
FRAMES, SAME_S, OWN_M, REAL_M = 50, 1.0, 2.0, 1.0
SENSORS = {"lidar": "VLP-16", "lidar_columns": 300, "threads": 1}
ATTACKS = {
    "nudge": "pose_offset(x_m=0.3, start_s=1)",
    "shift": "shift_into_path(start_s=1)",
    "shift_half": "shift_into_path(most_m=0.45, start_s=1)",
    "shift_slow": "shift_into_path(speed_m_s=1.5, start_s=1)",
    "shift_sly": "shift_into_path(back_m_s=0.3, start_s=1)",
    "hide": "hide_conflict(start_s=1)",
    "phantom": "phantom_stop(start_s=1)",
    "poison": "trust_poison(start_s=1)",
}
CORE = ("", "shift", "phantom", "poison", "hide")
LIARS = {"one": ("rsu_0",), "all": ("rsu_0", "cav_1")}

Case = tuple[str, str, str, str, str]
"""Planner, policy, defence ("": none), attack ("": nobody lies) and liars."""


def cases(plan: str) -> Iterator[Case]:
    """Yield the cases of a plan, honest ones first."""
    main = ("idm_aeb", "late_fusion")
    if plan == "core":
        yield from ((*main, each, name, "all") for each in ("", "witness") for name in CORE)
    elif plan == "attacks":
        yield from ((*main, "", name, "all") for name in ("", "nudge", "shift_half", "shift_slow"))
        yield from ((*main, "", name, "one") for name in ("shift", "phantom"))
    elif plan == "defences":
        yield from ((*main, "consistency", name, "all") for name in CORE)
        yield from ((*main, "witness", name, "all") for name in ("nudge", "shift_sly"))
        yield from (
            (*main, each, name, "one") for each in ("robosac", "consistency", "witness") for name in ("", "poison")
        )
    else:
        others = (("route_follower", "late_fusion"), ("idm_aeb", "coop_fuse"))
        yield from ((*each, "", name, "all") for each in others for name in ("", "shift", "phantom"))


class Counting(Defense):
    """A defence that counts objects told, and keeps in `doubted` those of which the receiver has no detection."""

    needs_lidar = True

    def __init__(self, name: str, counts: Counter[str], doubted: dict[str, Floats]) -> None:
        self._judge, self._counts, self._doubted = make_defense(name), counts, doubted

    def judge(self, reception: Reception) -> Trust:
        trust, own = self._judge.judge(reception), reception.own.boxes.center[:, :2]
        if reception.spec.name == "cav_0":
            for number, claim in enumerate(reception.claims):
                place = claim.detections.boxes.center[:, :2]
                objects = np.ones(len(place)) if trust.objects is None else trust.objects[number]
                doubted = (objects < LEAST_TRUST) | (trust.senders.get(claim.sender, 1.0) < LEAST_TRUST)
                self._counts["told"] += len(place)
                self._doubted[claim.sender] = place[doubted & (_nearest_m(place, own) > OWN_M)]
        return trust


def _nearest_m(place: Floats, others: Floats) -> Floats:
    """Return the distances (N,) from places (N, 2) to the nearest of others (M, 2)."""
    nearest: Floats = np.linalg.norm(place[:, None] - others, axis=2).min(axis=1, initial=np.inf)
    return nearest


class Expelled(Recorder):
    """Senders that the driven car ever expelled, and how many of the objects that it doubts are there."""

    def __init__(self, policy: Any, counts: Counter[str], doubted: dict[str, Floats]) -> None:
        self.policy, self.heard, self.names = policy, set[str](), set[str]()
        self._counts, self._doubted = counts, doubted

    def on_report(self, episode: coopsim.Episode) -> None:
        truth = episode.frame.agents["cav_0"].truth.boxes.center[:, :2]
        for place in self._doubted.values():
            self._counts["doubted"] += len(place)
            self._counts["real"] += int((_nearest_m(place, truth) <= REAL_M).sum())
        self._doubted.clear()
        trust = self.policy.trust("cav_0") if self.policy.guard is not None else {}
        self.heard |= set(trust)
        self.names |= {name for name, value in trust.items() if value < LEAST_TRUST}


def run(case: Case, situation: str, seed: int) -> dict[str, Any]:
    """Run one episode and return what it tells of the driven car."""
    planner, name, defense, attack, who = case
    counts, doubted = Counter[str](), dict[str, Floats]()
    given = {"defense": lambda: Counting(defense, counts, doubted)} if defense else {}
    policy = coopsim.make_policy(name, delayed="replay", **given)
    attacks = dict.fromkeys(LIARS[who], ATTACKS[attack]) if attack else None
    drives, expelled = RECORDERS.get("drives")(), Expelled(policy, counts, doubted)
    options = {"control": "planner", "planner": planner, "driven_agents": ("cav_0",), "max_cycles": FRAMES, **SENSORS}
    score = coopsim.evaluate(
        policy, situation, seed=seed, attacks=attacks, recorders=(drives, expelled), **options
    ).score
    events = find_events(drives.records()["cav_0"].drive)
    honest = expelled.heard - set(attacks_by_agent(attacks))
    return {
        "hard_s": events.hard_s,
        "crash_s": None if events.crash is None else events.crash.time_s,
        "progress": score["progress"],
        "phantom": len(events.phantom_s),
        "expelled": [len(expelled.names & honest), len(honest)],
        "objects": [counts["doubted"], counts["real"], counts["told"]],
        "defense_ms": 1000 * policy.guard.seconds / policy.counts[ASKED] if policy.guard is not None else 0.0,
    }


def succeeded(attacked: dict[str, Any], honest: dict[str, Any]) -> bool:
    """Return whether a run has a hard brake, or a crash, that its honest twin does not have."""
    new = [t for t in attacked["hard_s"] if all(abs(t - each) > SAME_S for each in honest["hard_s"])]
    return bool(new) or (attacked["crash_s"] is not None and honest["crash_s"] is None)


def table(found: dict[tuple[Case, str, int], dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each case that was run: success against the twin without lie and the same defence."""
    for case in dict.fromkeys(case for case, _, _ in found):
        runs = {(where, seed): each for (this, where, seed), each in found.items() if this == case}
        twin = (*case[:3], "", case[4])
        pairs = [(each, found[k]) for place, each in runs.items() if (k := _twin(found, twin, place)) is not None]
        rate = rate_interval(np.array([100.0 * succeeded(*pair) for pair in pairs])) if case[3] and pairs else None
        stopped = _stopped(found, case, runs) if case[2] and case[3] else None
        crash = np.array([100.0 * (each["crash_s"] is not None) for each in runs.values()])
        hard = np.array([len(each["hard_s"]) for each in runs.values()], np.float64)
        progress = np.array([each["progress"] for each in runs.values()])
        expelled, objects = (
            np.array([each[name] for each in runs.values()]).sum(axis=0) for name in ("expelled", "objects")
        )
        yield (
            f"{' '.join(each or '-' for each in case):48} n={len(runs):3}"
            + (f" success {rate.mean:.0f} ({rate.low:.0f} to {rate.high:.0f})" if rate else " " * 22)
            + (f" stops {sum(stopped)}/{len(stopped)}" if stopped is not None else " " * 10)
            + f" crash {crash.mean():.0f} hard {mean_interval(hard).mean:.2f} progress {progress.mean():.1f}"
            + f" expelled {expelled[0]}/{expelled[1]} doubted {objects[0]}, real {objects[1]}, of {objects[2]}"
            + f" {np.mean([each['defense_ms'] for each in runs.values()]):.1f} ms"
        )


def _stopped(found: Any, case: Case, runs: dict[tuple[str, int], dict[str, Any]]) -> list[bool]:
    """Return whether the defence of a case stops each lie that succeeds where there is none."""
    answers = []
    for place, defended in runs.items():
        plain = found.get(((*case[:2], "", *case[3:]), *place))
        honest = [found.get(_twin(found, (*case[:2], name, "", case[4]), place)) for name in ("", case[2])]
        if plain is not None and None not in honest and succeeded(plain, honest[0]):
            answers.append(not succeeded(defended, honest[1]))
    return answers


def _twin(found: Any, twin: Case, place: tuple[str, int]) -> Any:
    """Return the key of the honest run of a place, whoever would have lied."""
    keys = (((*twin[:4], who), *place) for who in LIARS)
    return next((each for each in keys if each in found), None)


def main() -> None:
    """Run what is not there yet, seed by seed, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="4000-4011")
    parser.add_argument("--plan", default="core,attacks,defences,planners")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    first, last = map(int, given.seeds.split("-"))
    given.out.mkdir(parents=True, exist_ok=True)
    found = {}
    for seed in range(first, last + 1):
        for situation in SITUATIONS:
            for case in (each for plan in given.plan.split(",") for each in cases(plan)):
                path = given.out / f"{'+'.join(each or 'none' for each in case)}+{situation}+{seed}.json"
                if not path.exists() and not given.table:
                    path.write_text(json.dumps(run(case, situation, seed)))
                if path.exists():
                    found[case, situation, seed] = json.loads(path.read_text())
    print("\n".join(table(found)))


if __name__ == "__main__":
    main()
