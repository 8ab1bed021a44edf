"""Measure the tables and the figure of docs/results about detection, pooled over the nine named places.

    python scripts/measure_detection.py --out results [--minutes 25] [--jobs 2] [--frames 40] [--seeds 0]
        [--only clean,noise] [--method "attention, seed 1=attfuse(weights=mine.safetensors)"]

Studies are measured in order of importance until the time is up; the same command goes on from there, and prints what
is finished. Into the folder go rows.json, tables.md and ap_over_bytes.svg. 3 cars receive from each other and a mast.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from detection_tables import CLEAN, Row, figure, tables
from tqdm import tqdm

from coopsim.bench.detect.detect import EVERYWHERE, DetectProgress, measure_detection
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.engine import Engine
from coopsim.cli.arguments import as_json, names, seeds
from coopsim.support.files import write_whole

PLACES = (
    "crossing", "urban_grid", "t_junction", "highway", "merge", "roundabout", "parking_street", "occluded_crossing",
    "platoon",
)  # fmt: skip
METHODS = {
    "none": "no_fusion",
    "late": "late_fusion(merge=nms, delayed=as_current)",
    "early": "early",
    "F-Cooper": "fcooper",
    "AttFuse": "attfuse",
    "Where2comm": "where2comm",
    "pyramid": "pyramid",
    "GSAF": "gsaf",
    "DiscoNet": "disconet",
    "V2VNet": "v2vnet",
    "CoBEVT": "cobevt",
    "V2X-ViT": "v2x_vit",
    "late, aligned": "late_fusion(merge=nms, align=true, delayed=as_current)",
    "Where2comm, aligned": "where2comm(align=true)",
}
_RAIN = {"weather": {"rain_mm_h": 10}}


@dataclass(frozen=True)
class Study:
    """Column of the table: a disturbance, or another world.

    Attributes:
        group: name on the command line.
        title: title of the column.
        noise: m and degrees.
        delay_ms: delay of messages.
        options: options of the environments.
        share: share of the frames that are measured.
        sends: True if methods that send nothing are left out, as nothing changes for them.
    """

    group: str
    title: str
    noise: tuple[float, float] = (0.0, 0.0)
    delay_ms: float = 0.0
    options: Mapping[str, Any] = field(default_factory=dict)
    share: float = 1.0
    sends: bool = False

    def plan(self, methods: Mapping[str, str], frames: int, of_seeds: Sequence[int], protocol: str) -> DetectPlan:
        """Return the plan of the study."""
        chosen = tuple(policy for policy in methods.values() if not (self.sends and policy == METHODS["none"]))
        return DetectPlan(
            chosen,
            PLACES,
            tuple(of_seeds),
            max(1, round(frames * self.share)),
            (self.noise,),
            (self.delay_ms,),
            # Late messages need frames as far apart as they are late: all of them are measured.
            every_s=min(0.5, self.delay_ms / 1000) or 0.5,
            protocol=protocol,
            options=self.options,
        )


FIRST = Study("clean", CLEAN)
STUDIES = (
    FIRST,
    Study("noise", "0.4 m, 0.4°", (0.4, 0.4), share=0.5, sends=True),
    Study("noise", "0.28 m, 0.28°", (0.28, 0.28), share=0.5, sends=True),
    Study("delay", "500 ms", delay_ms=500, share=0.5, sends=True),
    Study("delay", "200 ms", delay_ms=200, share=0.5, sends=True),
    Study("world", "rain 10 mm/h", options=_RAIN, share=0.5),
    Study("world", "VLP-16", options={"lidar": "VLP-16"}, share=0.5),
    Study("world", "OS1-128", options={"lidar": "OS1-128"}, share=0.5),
    Study("bytes", "10 kB", options={"budget_bytes": 10_000}, share=0.5, sends=True),
    Study("bytes", "1 kB", options={"budget_bytes": 1_000}, share=0.5, sends=True),
    Study("bytes", "100 kB", options={"budget_bytes": 100_000}, share=0.5, sends=True),
    Study("world", "furniture", options={"detail": "full"}, share=0.5),
    Study("noise", "0.2 m, 0.2°", (0.2, 0.2), share=0.5, sends=True),
    Study("noise", "0.6 m, 0.6°", (0.6, 0.6), share=0.5, sends=True),
    Study("delay", "100 ms", delay_ms=100, share=0.5, sends=True),
    Study("delay", "300 ms", delay_ms=300, share=0.5, sends=True),
)
"""In order of importance. Errors are of all agents: between two that err by 0.28 m they are those of 0.4 m of one."""


class TimeIsUpError(Exception):
    """The time that was given is over."""


def main() -> None:
    """Measure what there is time for, and write what is finished."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--frames", type=int, default=40, help="of each of nine places and each seed")
    parser.add_argument("--seeds", type=seeds, default=(0,))
    parser.add_argument("--only", type=names, help="groups: clean, noise, delay, world, bytes")
    parser.add_argument("--methods", type=names, help=", ".join(METHODS) + "; all where no --method is given")
    parser.add_argument("--method", action="append", default=[], metavar="TITLE=POLICY", help="beside --methods")
    given = parser.parse_args()
    methods = {name: METHODS[name] for name in given.methods or ([] if given.method else METHODS)}
    methods |= dict(each.split("=", 1) for each in given.method)
    studies = [study for study in STUDIES if given.only is None or study.group in given.only]
    given.out.mkdir(parents=True, exist_ok=True)
    rows = measure(studies, methods, given)
    protocols = by_protocol(methods, given) if FIRST in studies else []
    write_whole(given.out / "rows.json", as_json(rows + protocols))
    write_whole(given.out / "ap_over_bytes.svg", figure(rows, methods))
    text = tables(rows, protocols, methods)
    write_whole(given.out / "tables.md", text)
    print(text)


def measure(studies: Sequence[Study], methods: Mapping[str, str], given: argparse.Namespace) -> list[Row]:
    """Run the studies until the time is up. Return the rows of all that is finished, each with its `study`."""
    ends = time.monotonic() + 60 * given.minutes
    found: dict[str, list[Row]] = {}
    for number, study in enumerate(studies):
        plan = study.plan(methods, given.frames, given.seeds, "coopsim")
        check = number == 0
        with tqdm(total=1, desc=study.title, disable=None) as bar:

            def show(progress: DetectProgress, study: Study = study, bar: tqdm[Any] = bar) -> None:
                found[study.title] = [{"study": study.title, "group": study.group, **row} for row in progress.rows]
                bar.total, bar.n = progress.episodes, progress.done
                bar.refresh()
                if progress.outcome is not None and progress.outcome.reason is not None:
                    print(f"failed: {progress.outcome.job.policy.text}: {progress.outcome.reason}")
                if time.monotonic() > ends and progress.done < progress.episodes:
                    raise TimeIsUpError

            try:
                measure_detection(
                    plan,
                    check=check,
                    folder=given.out / "episodes",
                    engine=Engine(workers=given.jobs),
                    on_progress=show,
                )
            except (TimeIsUpError, KeyboardInterrupt):
                print(f"stopped in {study.title}: {bar.n} of {bar.total} episodes; the same command goes on")
                break
    return [row for rows in found.values() for row in rows]


def by_protocol(methods: Mapping[str, str], given: argparse.Namespace) -> list[Row]:
    """Return the pooled rows of the clean study by the other protocols; nothing is run for them."""
    rows: list[Row] = []

    def finished(progress: DetectProgress) -> None:
        rows.extend(row for row in progress.rows if row["environment"] == EVERYWHERE)
        raise TimeIsUpError  # before anything is run

    for protocol in ("opencood", "dair", "nuscenes", "v2x-real"):
        plan = FIRST.plan(methods, given.frames, given.seeds, protocol)
        try:
            measure_detection(plan, check=False, folder=given.out / "episodes", on_progress=finished)
        except TimeIsUpError:
            continue
    return rows


if __name__ == "__main__":
    main()
