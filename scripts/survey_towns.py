"""Draw towns, look for faults, drive their traffic or that of scenarios without sensing, and print tables.

    python scripts/survey_towns.py --places 0-499 --seconds 120 --processes 2
    python scripts/survey_towns.py --places 0-9999 --only-draw --processes 2
    python scripts/survey_towns.py --scenarios crossing,village.yaml --seeds 0-2 --seconds 3600 --processes 2

What is finished is kept in a file of JSON lines (--out), so that the same command goes on where it was stopped
(Ctrl-C); lines of other options are left alone. Delete the file after a change of the code. The measures are defined in
scripts/town_survey.py. Town k is driven with seed k.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import yaml
from tabulate import tabulate
from town_survey import JAM_S, Standstill, find_faults, fingerprint, survey_traffic
from tqdm import tqdm

from coopsim.cli.argument_types import names, seeds
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.population import Population
from coopsim.world.scenario import make_scenario
from coopsim.world.towns.scenarios import TownScenarios
from coopsim.world.towns.town import draw_place

Row = dict[str, Any]
QUANTILES = (0.5, 0.9, 0.99, 1.0)


def survey(place: int, *, options: TownOptions, density: float, seconds: float) -> Row:
    """Draw a place, check it and, unless `seconds` is 0, drive it; an error is noted, not raised."""
    row: Row = {"place": place}
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            began_s = perf_counter()
            drawn = draw_place(place, options)
            row["draw_ms"] = round(1e3 * (perf_counter() - began_s), 1)
            scenario = TownScenarios(PlaceSeeds(place), options, density, None, {}).of(place)
            row["fingerprint"] = fingerprint({} if drawn.description is None else drawn.description.plain)
            row["triangles"] = sum(len(part.faces) for part in (*scenario.layout.static, *scenario.layout.furnishing))
            row["faults"] = find_faults(scenario, place)
        row["warnings"] = [str(warning.message) for warning in caught]
        if seconds:
            row["drive"] = asdict(survey_traffic(scenario, place, seconds))
    except Exception as error:  # whatever happens in one of 10,000 places shall not stop the others
        row["error"] = f"{type(error).__name__}: {error}"
    return row


def survey_scenario(name_seed: tuple[str, int], *, numbers: Mapping[str, Any], seconds: float) -> Row:
    """Drive a scenario, or that of a file, with other numbers of a `Population`; its row is as `survey` has it."""
    name, seed = name_seed
    if name.endswith(".yaml"):
        file = load_scenario_file(name)
        counts = {each.name: file.keywords[each.name] for each in fields(Population) if each.name in file.keywords}
        scenario = make_scenario(file.scenario, **{**counts, **numbers})
    else:
        scenario = make_scenario(name, **numbers)
    return {"place": f"{name} {seed}", "drive": asdict(survey_traffic(scenario, seed, seconds))}


def scenario_table(rows: Sequence[Row]) -> str:
    """Return the table of scenarios, a row for each episode, in Markdown."""
    cells = []
    for row in rows:
        drive, waits_s = row["drive"], row["drive"]["waits_s"]
        speeds = f"{drive['first_m_s']:.1f}, {drive['last_m_s']:.1f}"
        cells.append([row["place"], len(drive["crashes"]), drive["fewest"], f"{max(waits_s, default=0):.0f}", speeds])
    heads = ("scenario", "crashes", "actors, least", "longest standstill, s", "m/s, first and last sixth")
    return tabulate(cells, heads, tablefmt="github", disable_numparse=True)


def validity_table(rows: Sequence[Row]) -> str:
    """Return the table of drawing and faults, in Markdown."""
    good = [row for row in rows if "error" not in row]
    faults = Counter(re.sub(r"[\d.]+", "#", fault) for row in good for fault in row["faults"])
    errors = Counter(re.sub(r"[\d.]+", "#", row["error"])[:110] for row in rows if "error" in row)
    table = [
        ["places", len(rows)],
        ["different ones", len({row["fingerprint"] for row in good})],
        ["that raised an error", len(rows) - len(good)],
        *([f"... {kind}", count] for kind, count in errors.most_common()),
        ["with a fault", sum(bool(row["faults"]) for row in good)],
        *([f"... {kind}", count] for kind, count in faults.most_common()),
        ["with a warning", sum(bool(row["warnings"]) for row in good)],
        [f"ms to draw one: {_names()}", _quantiles([row["draw_ms"] for row in good])],
        [f"triangles: {_names()}", _quantiles([row["triangles"] for row in good])],
    ]
    return tabulate(table, ("drawn towns", ""), tablefmt="github", disable_numparse=True)


def traffic_table(rows: Sequence[Row]) -> str:
    """Return the table of traffic, in Markdown."""
    drives = [row["drive"] for row in rows if "drive" in row]
    all_crashes = [each for drive in drives for each in drive["crashes"]]
    hours = sum(drive["vehicle_hours"] for drive in drives)
    crashes, touches = (sum(each["parked"] == parked for each in all_crashes) for parked in (False, True))
    waits_s = [wait_s for drive in drives for wait_s in drive["waits_s"]]
    table = [
        ["places", len(drives)],
        ["seconds in each", "; ".join(f"{each:g}" for each in sorted({drive["seconds"] for drive in drives}))],
        ["vehicle-hours", f"{hours:.1f}"],
        ["crashes", crashes],
        ["crashes in 100 vehicle-hours", f"{100 * crashes / hours:.2f}"],
        ["parked vehicles that people walked into", touches],
        ["mean speed, m/s", f"{sum(drive['distance_km'] for drive in drives) / hours / 3.6:.2f}"],
        [f"standstills longer than {JAM_S:g} s", sum(len(drive["jams"]) for drive in drives)],
        ["places with one", sum(bool(drive["jams"]) for drive in drives)],
        [f"of these, with nobody moving around for {JAM_S:g} s", sum(map(_frozen, drives))],
        ["places with one of those", sum(_frozen(drive) > 0 for drive in drives)],
        [f"standstills, s: {_names()}", _quantiles(waits_s)],
    ]
    return tabulate(table, ("traffic", ""), tablefmt="github", disable_numparse=True)


def list_troubles(rows: Sequence[Row]) -> list[str]:
    """Return a line for everything that went wrong, with its place, to look at it."""
    lines = []
    for row in rows:
        drive = row.get("drive", {})
        found = [row["error"]] if "error" in row else []
        found += row.get("faults", []) + row.get("warnings", [])
        found += [
            f"crash of {each['vehicles']} at {each['time_s']} s, {_spot(each)}" for each in drive.get("crashes", [])
        ]
        for each in drive.get("jams", []):
            still = f"nobody around moves for {each['frozen_s']} s"
            found.append(f"{each['vehicle']} stands {each['for_s']} s from {each['since_s']} s, {still}, {_spot(each)}")
        lines += [f"place {row['place']}: {what}" for what in found]
    return lines


def _frozen(drive: Row) -> int:
    return sum(Standstill(**jam).is_deadlock for jam in drive["jams"])


def _spot(each: Row) -> str:
    return f"({each['x_m']}, {each['y_m']}) m"


def _names() -> str:
    return ", ".join("most" if share == 1 else f"{share:.0%}" for share in QUANTILES)


def _quantiles(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in np.quantile(values, QUANTILES)) if values else "none"


def read_rows(path: Path, settings: str) -> dict[int, Row]:
    """Return the finished places of a file with these settings; a last line that was cut off is left out."""
    rows = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row["settings"] == settings:
            rows[row["place"]] = row
    return rows


def run(arguments: argparse.Namespace) -> dict[int, Row]:
    """Survey the places that are not in the file yet, and add them to it; Ctrl-C ends this early."""
    job: dict[str, Any] = {"seconds": 0.0 if arguments.only_draw else arguments.seconds}
    wanted: dict[Any, Any] = {place: place for place in arguments.places}
    made: Callable[..., Row] = survey
    if arguments.scenarios:
        made, job["numbers"] = survey_scenario, arguments.numbers
        wanted = {f"{name} {seed}": (name, seed) for name in arguments.scenarios for seed in arguments.seeds}
    else:
        options = TownOptions(
            arguments.junctions, arguments.openness, arguments.lanes, traffic_side=arguments.traffic_side
        )
        job = {"options": options, "density": arguments.density, **job}
    settings = str(job)
    rows = read_rows(arguments.out, settings)
    left = [each for place, each in wanted.items() if place not in rows]
    context = get_context("spawn")
    pool = context.Pool(arguments.processes, signal.signal, (signal.SIGINT, signal.SIG_IGN), maxtasksperchild=200)
    bar = tqdm(total=len(wanted), initial=len(wanted) - len(left), unit="place", smoothing=0.05)
    with pool, bar, arguments.out.open("a") as file:
        try:
            for row in pool.imap_unordered(partial(made, **job), left):
                rows[row["place"]] = row | {"settings": settings}
                file.write(json.dumps(rows[row["place"]]) + "\n")
                file.flush()
                bar.update()
        except KeyboardInterrupt:
            print(f"stopped; the same command goes on from {arguments.out}", file=sys.stderr)
    return {place: rows[place] for place in wanted if place in rows}


def main() -> None:
    """Read the arguments, survey, print."""
    parser = argparse.ArgumentParser(description="Survey towns and scenarios: faults, crashes, jams.")
    parser.add_argument("--places", type=seeds, default="0-19", help="place seeds, as 0-499 (default: 0-19)")
    parser.add_argument("--scenarios", type=names, default=(), help="drive these, or scenario files, in place of towns")
    parser.add_argument("--seeds", type=seeds, default="0", help="of the scenarios' traffic (default: %(default)s)")
    parser.add_argument("--numbers", type=yaml.safe_load, default={}, help="of scenarios' actors: '{buses: 8}'")
    parser.add_argument("--seconds", type=float, default=120.0, help="to drive each (default: %(default)g)")
    parser.add_argument("--only-draw", action="store_true", help="drive none")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("town_survey.jsonl"), help="default: %(default)s")
    parser.add_argument("--density", type=float, default=1.0, help="factor on the usual numbers of vehicles and people")
    parser.add_argument("--junctions", type=int, help="of each town (default: drawn)")
    parser.add_argument("--openness", type=float, help="of each town, 0 to 1 (default: drawn)")
    parser.add_argument("--lanes", type=int, help="most a direction, 1 to 3 (default: drawn)")
    parser.add_argument("--traffic-side", default="right", help="right or left (default: %(default)s)")
    arguments = parser.parse_args()
    rows = list(run(arguments).values())
    if arguments.scenarios:
        print("\n".join(list_troubles(rows)), scenario_table(rows), sep="\n\n")
        return
    if rows:
        print("\n".join(list_troubles(rows)), validity_table(rows), sep="\n\n")
    if any("drive" in row for row in rows):
        print(f"\n{traffic_table(rows)}")


if __name__ == "__main__":
    main()
