"""Pairs of runs in a report: panels from above that are played up to the crash, with marks of what happened."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.bench.films.drive_moments import tracked
from coopsim.bench.films.film import Rows, to_rows
from coopsim.bench.films.recording import Recording
from coopsim.bench.grid.labels import label
from coopsim.bench.report.film_data import frame_data, home_of, map_data, place_data, rows_data, run_data
from coopsim.bench.report.film_section import Figure, Panel
from coopsim.bench.report.keys import FALSE_NOTE, SCENE
from coopsim.bench.report.space_data import pair_view
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.pair_clip import outcome
from coopsim.geometry.se3 import Floats

_LEAD_S, _AFTER_S = 5.0, 1.5
"""Time shown before the crash, and after it where the other run goes on."""

NOTE = f"""The same seed without messages (left) and with them (right), of which one ended in a crash.
The world is the same until the cars drive differently. Each situation is there once for a seed. Click a moment to see
it. {FALSE_NOTE}
<code>coopsim clip FOLDER --pair N</code> makes a film of a pair."""

KEYS = (*SCENE, "hidden", "known", "told")

_SPAN_M = 80

Runs = tuple[Recording, Recording]


def crash_figure(runs: Runs, table: ResultTable) -> Figure:
    """Return a pair as a figure."""
    alone, sharing = runs
    first_s, last_s = _window(runs)
    met = "a crash that messages avoid" if alone.events.crash_s is not None else "a crash that comes with messages"
    where = f"{label(sharing.cell.condition, table.conditions)}, seed {sharing.cell.seed}"
    home = home_of(alone.film.frames)
    data = {
        "agent": alone.agent,
        "start_s": round(first_s, 3),
        "dt_s": round(float(np.diff(alone.drive.time_s[:2])[0]), 6),
        "span": _SPAN_M,
        "map": map_data(alone.film.road_map, home),
        "eye": (_eye(runs) - home).round(1).tolist(),
        "sides": [_side(run, first_s, last_s, home) for run in runs],
    }
    frames = np.flatnonzero((alone.drive.time_s > first_s - 1e-6) & (alone.drive.time_s < last_s + 1e-6))
    labels, films = [run.cell.policy for run in runs], [run.film for run in runs]
    space = pair_view(labels, films, alone.agent, int(frames[0]), int(frames[0]) + _frames(runs))
    return Figure(f"{where}: {met}", [_panel(run, first_s) for run in runs], data, space)


def _frames(runs: Runs) -> int:
    """Return the number of frames that are shown."""
    first_s, last_s = _window(runs)
    return max(int(((run.drive.time_s > first_s - 1e-6) & (run.drive.time_s < last_s + 1e-6)).sum()) for run in runs)


def _panel(run: Recording, first_s: float) -> Panel:
    moments = [(max(at_s, first_s), f"{at_s:.1f} s {text}") for at_s, _, text in run.events.words()]
    return Panel(run.cell.policy, outcome(run), moments)


def _window(runs: Runs) -> tuple[float, float]:
    crash_s = max(run.events.crash_s for run in runs if run.events.crash_s is not None)
    return max(0.0, crash_s - _LEAD_S), min(crash_s + _AFTER_S, max(run.end_s for run in runs))


def _eye(runs: Runs) -> Floats:
    """Return the middle (2,) of where the crash is and where its car was when the film begins."""
    run = next(run for run in runs if run.events.crash_s is not None)
    times = run.drive.time_s
    ends: Floats = run.drive.car[[int(np.searchsorted(times, _window(runs)[0])), int(run.drive.crashed.argmax())], :2]
    middle: Floats = ends.mean(axis=0)
    return middle


def _side(run: Recording, first_s: float, last_s: float, home: Floats) -> dict[str, Any]:
    """Return the frames of a run; those after a crash are not there, and the page shows its last one."""
    drive, known = run.drive, tracked(run.drive)
    shown = np.flatnonzero((drive.time_s > first_s - 1e-6) & (drive.time_s < last_s + 1e-6))
    if run.events.crash_s is not None:
        shown = shown[drive.time_s[shown] < run.events.crash_s + 1e-6]
    # Nothing was reported for the last frame, and so it was not filmed.
    filmed = np.minimum(shown, len(drive) - 2).tolist()
    frames, marks = [], []
    for k, reported in zip(shown.tolist(), filmed, strict=True):
        made = frame_data(run.film.frames[reported], home, run.agent)
        if k > reported:
            made |= {"truth": rows_data(_bodies(run, k), home), "agents": _agents(run, k, made["agents"], home)}
        frames.append(made)
        there = np.flatnonzero(drive.in_conflict & np.isfinite(drive.boxes[k, :, 0]))
        met = [[*place_data(drive.boxes[k, a, :2], home), bool(known[reported, a])] for a in there.tolist()]
        arrived = [name for name in sorted(run.film.reached(run.agent, k)) if name in run.others(reported)]
        marks.append({"met": met, "arrived": arrived, "crash": bool(drive.crashed[k])})
    x, y, length, _, yaw = drive.car[-1].tolist()
    front = place_data((x + length / 2 * np.cos(yaw), y + length / 2 * np.sin(yaw)), home)
    return {"frames": frames, "runs": [run_data(run.film, run.agent, filmed, home)], "marks": marks, "crash": front}


def _bodies(run: Recording, k: int) -> Rows:
    drive = run.drive
    there = np.isfinite(drive.boxes[k, :, 0])
    return to_rows(np.append(drive.ids[there], 0), np.vstack([drive.boxes[k, there], drive.car[k]]))


def _agents(run: Recording, k: int, agents: list[list[Any]], home: Floats) -> list[list[Any]]:
    """Return agents as they stand in a page's frame, with the driven car where it is in frame `k`."""
    place = place_data(run.drive.car[k, :2], home)
    return [[name, *place, riding] if name == run.agent else [name, x, y, riding] for name, x, y, riding in agents]
