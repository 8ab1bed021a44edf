"""Measure the tables of docs/results about cameras: points, pictures and both, by day, dusk and night, in rain and fog.

    python scripts/measure_cameras.py --out results [--minutes 25] [--jobs 2] [--frames 20] [--seeds 0]
        [--only points,pictures,both,mixed] [--light day,night] [--method "pictures:GSAF=gsaf(sensors=pictures)"]

The nine named places, as in measure_detection.py, whose truth it has: what the LiDARs of some agent hit, whether they
are used or not. Every agent has four cameras. Episodes are kept in the folder: the same command goes on where it
stopped. Into the folder go cameras.json and cameras.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from measure_detection import PLACES, TimeIsUpError
from tabulate import tabulate

from coopsim.bench.detect.detect import EVERYWHERE, DetectProgress, measure_detection
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.engine import Engine
from coopsim.cli.arguments import as_json, names, seeds
from coopsim.errors import InvalidValueError
from coopsim.support.files import write_whole

_SURROUND = {"cameras": "surround"}


@dataclass(frozen=True)
class Sensing:
    """What agents see with.

    Attributes:
        detector: of policies that detect nothing themselves.
        options: of the environments.
        methods: policies by title.
    """

    detector: str
    options: Mapping[str, Any]
    methods: Mapping[str, str] = field(default_factory=dict)


def _fusions(sensors: str) -> dict[str, str]:
    named = {"F-Cooper": "fcooper", "AttFuse": "attfuse", "Where2comm": "where2comm", "pyramid": "pyramid"}
    return {title: f"{name}(sensors={sensors})" for title, name in named.items()}


_BOXES = {"none": "no_fusion", "late": "late_fusion(merge=nms)"}
GROUPS = {
    "points": Sensing("pillars", {}, _BOXES | _fusions("points")),
    "pictures": Sensing("lift_splat", _SURROUND, _BOXES | _fusions("pictures")),
    "both": Sensing("points_and_pictures", _SURROUND, _BOXES | _fusions("both")),
    # Cars have LiDARs alone, masts cameras alone.
    "mixed": Sensing("pillars", {"lidar_agents": ["cav"], "cameras": {"rsu": "surround"}}, _fusions("mixed")),
}
LIGHT: Mapping[str, Mapping[str, Any]] = {
    "day": {},
    "night": {"time_of_day": "night"},
    "rain": {"weather": {"rain_mm_h": 10}},
    "fog": {"weather": {"fog_visibility_m": 100}},
    "dusk": {"time_of_day": "dusk"},
}
"""Options of environments by condition, in order of importance: rain of 10 mm/h, fog in which one sees 100 m."""

COLUMNS = {
    "APBEV@0.5 0-30m": "vehicles, 30 m",
    "APBEV@0.5": "vehicles",
    "APBEV@0.3 people": "people",
    "APBEV@0.3 riders": "riders",
}


def main() -> None:
    """Measure what there is time for, and write what is finished."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--frames", type=int, default=20, help="of each of nine places and each seed")
    parser.add_argument("--seeds", type=seeds, default=(0,))
    parser.add_argument("--only", type=names, default=tuple(GROUPS), help=", ".join(GROUPS))
    parser.add_argument("--light", type=names, default=tuple(LIGHT), help=", ".join(LIGHT))
    parser.add_argument("--titles", type=names, help="of the methods, as none, late, AttFuse")
    parser.add_argument("--method", action="append", default=[], metavar="GROUP:TITLE=POLICY", help="one more")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = measure(given)
    write_whole(given.out / "cameras.json", as_json(rows))
    text = tables(rows)
    write_whole(given.out / "cameras.md", text)
    print(text)


def measure(given: argparse.Namespace) -> list[dict[str, Any]]:
    """Run until the time is up. Return the pooled rows of all that is finished, with `light`, `sees` and `title`."""
    ends = time.monotonic() + 60 * given.minutes
    rows: list[dict[str, Any]] = []
    try:
        for light in given.light:
            for sees in given.only:
                rows += _pooled(light, sees, given, ends)
    except (TimeIsUpError, KeyboardInterrupt):
        print("stopped; the same command goes on")
    return rows


def _pooled(light: str, sees: str, given: argparse.Namespace, ends: float) -> list[dict[str, Any]]:
    group = GROUPS[sees]
    methods = {
        title: policy for title, policy in group.methods.items() if given.titles is None or title in given.titles
    }
    for each in given.method:
        where, colon, named = each.partition(":")
        if not colon or where not in GROUPS or "=" not in named:
            raise InvalidValueError(
                f"--method must be GROUP:TITLE=POLICY, with a group of {list(GROUPS)}, got {each!r}"
            )
        if where == sees:
            methods |= dict([named.split("=", 1)])
    found: list[dict[str, Any]] = []

    def show(progress: DetectProgress) -> None:
        found[:] = [row for row in progress.rows if row["environment"] == EVERYWHERE]
        print(f"{light}, {sees}: {progress.done} of {progress.episodes}", flush=True)
        if progress.outcome is not None and progress.outcome.reason is not None:
            print(f"failed: {progress.outcome.job.policy.text}: {progress.outcome.reason}")
        if time.monotonic() > ends and progress.done < progress.episodes:
            raise TimeIsUpError

    plan = DetectPlan(
        tuple(methods.values()),
        PLACES,
        tuple(given.seeds),
        given.frames,
        detector=group.detector,
        options={**group.options, **LIGHT[light]},
    )
    measure_detection(
        plan, check=False, folder=given.out / "episodes", engine=Engine(workers=given.jobs), on_progress=show
    )
    titles = {policy: title for title, policy in methods.items()}
    return [{"light": light, "sees": sees, "title": titles[row["policy"]], **row} for row in found]


def tables(rows: list[dict[str, Any]]) -> str:
    """Return the tables as Markdown: by day, and what light and weather change."""
    parts = []
    day = [row for row in rows if row["light"] == "day"]
    cells = [
        [row["sees"], row["title"], *(_number(row[metric]) for metric in COLUMNS), f"{row['bytes_per_message']:,.0f}"]
        + [f"{row[part]:.0f}" for part in ("ms_environment", "ms_uplink", "ms_policy")]
        for row in day
    ]
    heads = ("", "", *COLUMNS.values(), "bytes", "ms environment", "ms uplink", "ms policy")
    parts.append("## By day\n\n" + tabulate(cells, heads, tablefmt="github", disable_numparse=True))
    for metric, title in COLUMNS.items():
        by_place: dict[tuple[str, str], dict[str, str]] = {}
        for row in rows:
            by_place.setdefault((row["sees"], row["title"]), {})[row["light"]] = _number(row[metric])
        lights = list(dict.fromkeys(row["light"] for row in rows))
        cells = [[*key, *(each.get(light, "-") for light in lights)] for key, each in by_place.items()]
        text = tabulate(cells, ("", "", *lights), tablefmt="github", disable_numparse=True)
        parts.append(f"## {metric}: {title}\n\n{text}")
    return "\n\n".join(parts) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


if __name__ == "__main__":
    main()
