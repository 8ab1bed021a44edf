"""Pairs of runs in a report: panels from above that are played up to the crash, with marks of what happened."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from coopsim.bench.grid.labels import label
from coopsim.bench.report.keys import FALSE_NOTE, SCENE, keys_html
from coopsim.bench.report.scene import boxes_data, frame_data, home_of, map_data, tracks_data
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.moments import tracked
from coopsim.bench.safety.pair_clip import outcome
from coopsim.bench.safety.recording import Recording
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats

_LEAD_S, _AFTER_S = 5.0, 1.5
"""Time shown before the crash, and after it where the other run goes on."""

_NOTE = f"""<p class="note">The same seed without messages (left) and with them (right), of which one ended in a crash.
The world is the same until the cars drive differently. Each situation is there once for a seed. Click a moment to see
it. {FALSE_NOTE}
<code>coopsim clip FOLDER --pair N</code> makes a film of a pair.</p>"""

Filmed = Sequence[tuple[Recording, Recording]]


def pairs_section(filmed: Filmed, notes: Sequence[str], table: ResultTable) -> str:
    """Return the section as HTML; empty without pairs and notes."""
    if not filmed and not notes:
        return ""
    figures = "".join(_figure(k, runs, table) for k, runs in enumerate(filmed))
    listed = "".join(f'<p class="note">{html.escape(note)}</p>' for note in notes)
    legend = keys_html((*SCENE, "hidden", "known", "told")) if filmed else ""
    return f"<section><h2>Telling pairs</h2>{_NOTE}{legend}{figures}{listed}</section>"


def _figure(number: int, runs: tuple[Recording, Recording], table: ResultTable) -> str:
    alone, sharing = runs
    first_s, _ = _window(runs)
    where = f"{label(sharing.cell.condition, table.conditions)}, seed {sharing.cell.seed}"
    panels = "".join(_panel(side, run, first_s) for side, run in enumerate(runs))
    met = "a crash that messages avoid" if alone.events.crash_s is not None else "a crash that comes with messages"
    return (
        f'<figure class="clip" data-pair="{number}"><figcaption>{number + 1}. {html.escape(where)}: {met}</figcaption>'
        f'<div class="pair">{panels}</div><div class="player"><button>Play</button><input type="range" min="0" '
        'value="0" aria-label="frame" autocomplete="off"><output></output></div></figure>'
    )


def _panel(side: int, run: Recording, first_s: float) -> str:
    name = html.escape(run.cell.policy)
    buttons = "".join(
        f'<button class="moment" data-s="{max(at_s, first_s):.3f}">{at_s:.1f} s {html.escape(text)}</button>'
        for at_s, _, text in run.events.words()
    )
    return (
        f'<div><p><b>{name}</b> <span class="dim">{html.escape(outcome(run))}</span></p>'
        f'<canvas data-side="{side}" role="img" aria-label="{name} from above"></canvas>'
        f'<div class="moments">{buttons}</div></div>'
    )


def pair_data(runs: tuple[Recording, Recording]) -> dict[str, Any]:
    """Return plain data of a pair for the page's script."""
    first_s, last_s = _window(runs)
    home = home_of(runs[0].frames)
    return {
        "start_s": round(first_s, 3),
        "dt_s": round(float(np.diff(runs[0].drive.time_s[:2])[0]), 6),
        "map": map_data(runs[0].road_map, home),
        "eye": (_eye(runs) - home).round(1).tolist(),
        "sides": [_side(run, first_s, last_s, home) for run in runs],
    }


def _window(runs: tuple[Recording, Recording]) -> tuple[float, float]:
    crash_s = max(run.events.crash_s for run in runs if run.events.crash_s is not None)
    return max(0.0, crash_s - _LEAD_S), min(crash_s + _AFTER_S, max(run.end_s for run in runs))


def _eye(runs: tuple[Recording, Recording]) -> Floats:
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
    frames, tracks, marks = [], [], []
    for k in shown.tolist():
        reported = min(k, len(drive) - 2)
        frame = run.frames[reported]
        made = frame_data(frame, home)
        if k > reported:  # nothing was reported for the last frame, and so it was not filmed
            made = {**made, "truth": _bodies(run, k, home), "agents": _agents(run, k, made["agents"], home)}
        frames.append(made)
        tracks.append(tracks_data({n: each for n, each in frame.tracks.items() if n == run.agent}, home))
        there = np.flatnonzero(drive.in_conflict & np.isfinite(drive.boxes[k, :, 0]))
        met = [[*(drive.boxes[k, a, :2] - home).round(2).tolist(), bool(known[reported, a])] for a in there.tolist()]
        arrived = [name for name in sorted(run.arrived[k]) if name in run.others(reported)]
        marks.append({"met": met, "arrived": arrived, "crash": bool(drive.crashed[k])})
    front = drive.car[-1, :2] + drive.car[-1, 2] / 2 * np.array([np.cos(drive.car[-1, 4]), np.sin(drive.car[-1, 4])])
    place = (front - home).round(2).tolist()
    return {"agent": run.agent, "frames": frames, "runs": [{"tracks": tracks}], "marks": marks, "crash": place}


def _bodies(run: Recording, k: int, home: Floats) -> str:
    drive = run.drive
    there = np.isfinite(drive.boxes[k, :, 0])
    rows = np.vstack([drive.boxes[k, there], drive.car[k]])
    boxes = np.column_stack([rows[:, :2], np.ones(len(rows)), rows[:, 2:4], np.ones(len(rows)), rows[:, 4]])
    ids = np.append(drive.ids[there], 0)
    return boxes_data(ids, Boxes3D.from_array(boxes), home)


def _agents(run: Recording, k: int, agents: list[list[Any]], home: Floats) -> list[list[Any]]:
    """Return agents as they stand in a page's frame, with the driven car where it is in frame `k`."""
    place = (run.drive.car[k, :2] - home).round(2).tolist()
    return [[name, *place, riding] if name == run.agent else [name, x, y, riding] for name, x, y, riding in agents]
