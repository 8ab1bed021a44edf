"""Measure the counterparts of Tables II to V of the paper on DINO-CoDT (He et al., 2025) in the simulator.

    python scripts/measure_dino_codt.py --out results [--frames 60] [--seeds 0] [--places crossing,highway]

Table II: average precision by superclass, by the protocol of V2X-Real. Table III: tracks of the same policies, by
superclass. Table IV: vehicles alone, by the protocol of OPV2V. Table V: what parts of the method bring, of people.
What is tracked is what the networks find; AB3DMOT tracks it where nothing else is said. Episodes are kept in the
folder: the same command goes on where it stopped. Into the folder goes dino_codt.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from measure_detection import PLACES
from tabulate import tabulate

import coopsim
from coopsim.bench.detect.detect import EVERYWHERE, measure_detection
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.engine import Engine
from coopsim.cli.arguments import names, seeds
from coopsim.support.files import write_whole

DETECTION = {
    "no fusion": "no_fusion",
    "late": "late_fusion(merge=nms)",
    "early": "early",
    "F-Cooper": "fcooper",
    "AttFuse": "attfuse",
    "V2X-ViT": "v2x_vit",
    "DINO-CoDT (GSAF)": "gsaf",
}
TRACKING = {
    "F-Cooper": "fcooper",
    "AttFuse": "attfuse",
    "V2X-ViT": "v2x_vit",
    "GSAF, AB3DMOT": "gsaf",
    "DINO-CoDT": "dino_codt",
}
PARTS = {
    "V2X-ViT": "v2x_vit",
    "GSAF": "gsaf",
    "V2X-ViT, rules by class and age by speed": "v2x_vit(tracker='dino_codt_tracking(age_per_m_s=1.1)')",
    "all": "dino_codt(tracker='dino_codt_tracking(age_per_m_s=1.1)')",
}
TRACKED = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "IDS")
SUPERCLASSES = ("Vehicle", "Pedestrian", "Truck")
BY_SUPERCLASS = (*(f"APBEV@{iou} {name}" for name in SUPERCLASSES for iou in (0.3, 0.5)), "mAPBEV@0.3", "mAPBEV@0.5")


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--frames", type=int, default=60, help="of each place and seed")
    parser.add_argument("--seeds", type=seeds, default=(0,))
    parser.add_argument("--places", type=names, default=PLACES)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tracked = {policy: _tracks(policy, given) for policy in dict.fromkeys([*TRACKING.values(), *PARTS.values()])}
    parts = [
        "## II: average precision by superclass\n\n" + _detection(given, "v2x-real", BY_SUPERCLASS),
        "## III: tracks by superclass\n\n" + _tracking(TRACKING, tracked, SUPERCLASSES),
        "## IV: vehicles by the protocol of OPV2V\n\n" + _detection(given, "opencood", ("APBEV@0.5", "APBEV@0.7")),
        "## V: parts of the method, people\n\n" + _tracking(PARTS, tracked, ("Pedestrian",)),
    ]
    text = "\n\n".join(parts) + "\n"
    write_whole(given.out / "dino_codt.md", text)
    print(text)


def _tracks(policy: str, given: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Return the mean metrics over places and seeds, by superclass and name."""
    episodes = [_episode(policy, place, seed, given) for place in given.places for seed in given.seeds]
    found: dict[str, dict[str, float]] = {}
    for superclass in SUPERCLASSES:
        seen = [each[superclass] for each in episodes if superclass in each]
        if seen:
            found[superclass] = {name: sum(each[name] for each in seen) / len(seen) for name in TRACKED}
    return found


def _episode(policy: str, place: str, seed: int, given: argparse.Namespace) -> dict[str, dict[str, float]]:
    kept = given.out / "tracks" / f"{coopsim.__version__} {policy} {place} {seed} {given.frames}.json".replace("/", "_")
    if not kept.exists():
        made = coopsim.evaluate(policy, place, seed=seed, max_cycles=given.frames, connected_cars=3, rsus=1)
        scores = {
            name: {each: score.values[each] for each in TRACKED} for name, score in made.score.superclasses.items()
        }
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, json.dumps(scores))
        print(f"{policy}, {place}, seed {seed}: done", flush=True)
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def _detection(given: argparse.Namespace, protocol: str, columns: Sequence[str]) -> str:
    """Return the table of all policies that detect, by a protocol; episodes are run once for all protocols."""
    plan = DetectPlan(
        tuple(DETECTION.values()), tuple(given.places), tuple(given.seeds), given.frames, protocol=protocol
    )
    rows = measure_detection(plan, folder=given.out / "episodes", engine=Engine(workers=given.jobs))
    pooled = {row["policy"]: row for row in rows if row["environment"] == EVERYWHERE}
    cells = [[title, *(_number(pooled[policy].get(each)) for each in columns)] for title, policy in DETECTION.items()]
    return _table(cells, columns)


def _tracking(
    methods: Mapping[str, str], tracked: Mapping[str, Mapping[str, Mapping[str, float]]], wanted: Sequence[str]
) -> str:
    columns = [f"{superclass} {name}" for superclass in wanted for name in TRACKED]
    cells = [
        [title, *(_number(tracked[policy].get(superclass, {}).get(name)) for superclass in wanted for name in TRACKED)]
        for title, policy in methods.items()
    ]
    return _table(cells, columns)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _table(cells: Sequence[Sequence[str]], heads: Sequence[str]) -> str:
    return tabulate(cells, ("", *heads), tablefmt="github", disable_numparse=True)


if __name__ == "__main__":
    main()
