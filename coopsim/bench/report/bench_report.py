"""The report of a benchmark or demonstration: one HTML file that opens without a network."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coopsim.bench.grid.labels import label, values_of, varying_axes
from coopsim.bench.report.bench_tables import condition_table, failures, leaderboard
from coopsim.bench.report.bench_text import COUNTS_TITLE, METHODS_TITLE, interval_kinds
from coopsim.bench.report.clips import Clip
from coopsim.bench.report.formats import definitions, fill_page
from coopsim.bench.report.keys import FALSE_NOTE, SCENE, keys_html
from coopsim.bench.report.lie_pages import lie_data, lies_section
from coopsim.bench.report.lie_pairs import FilmedLie
from coopsim.bench.report.scene import DRAWING, Scene
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.pair_pages import Filmed, pair_data, pairs_section
from coopsim.bench.safety.pairs import CRASH
from coopsim.bench.safety.safety_page import crashes_section
from coopsim.metrics.built_in import BYTES, all_metrics, less_is_better
from coopsim.support.files import write_whole

_CLIPS_NOTE = f"""<p class="note">Windows in which a policy fell farthest behind the best one in the same condition and
seed, varied in policy, condition and traffic. Left the policy, right the best one at the same time. The agent is the
one whose MOTA differs most. {FALSE_NOTE}</p>"""


@dataclass(frozen=True, slots=True, eq=False)
class About:
    """Texts of a report besides the results; `command` reproduces them, `settings` are configuration and versions by
    name.
    """

    title: str = "coopsim bench"
    command: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """Runs that a report plays, and lines on those that are missing.

    Attributes:
        clips: clips of the worst moments, shown where no car was driven.
        pairs: recordings of telling pairs, shown where cars were driven.
        notes: lines on missing ones of these.
        lies: films of pairs with a lie.
        lie_notes: lines on missing ones of these.
    """

    clips: Sequence[Clip] = ()
    pairs: Filmed = ()
    notes: Sequence[str] = ()
    lies: Sequence[FilmedLie] = ()
    lie_notes: Sequence[str] = ()


def write_bench_report(
    path: Path,
    table: ResultTable,
    about: About,
    played: Played | None = None,
    scene: Scene | None = None,
) -> Path:
    """Write the report of `render_bench_report`; the file appears whole or not at all."""
    return write_whole(path, render_bench_report(table, about, played, scene))


def render_bench_report(
    table: ResultTable,
    about: About,
    played: Played | None = None,
    scene: Scene | None = None,
) -> str:
    """Return the report as HTML; equal results give equal text.

    Where cars were driven it has their crash rates. Sections of `played` runs without any run and note are left out;
    without a `scene` of runs to watch side by side, the sections "From above", "Reward over time" and "Cameras".
    """
    shown, played = table.shown, played or Played()
    return fill_page(
        "bench.html",
        style=("page.css", "bench.css"),
        script=("bev.js", "curves.js", "bench.js", *(["scene.js"] if scene else [])),
        data={**_data(table, played), **({"scene": scene.data()} if scene else {})},
        title=about.title,
        summary=_summary(table),
        leaderboards="".join(
            f'<div data-metric="{html.escape(name)}"{" hidden" * (name != shown[0])}>{leaderboard(table, name)}</div>'
            for name in shown
        )
        or '<p class="note">No run was finished, so there is nothing to rank.</p>',
        interval=_interval_note(table),
        scene=scene.html() if scene else "",
        crashes=crashes_section(table),
        lies=lies_section(played.lies, played.lie_notes, table, len(played.pairs)),
        clips=pairs_section(played.pairs, played.notes, table)
        if CRASH in table.metrics
        else _clips(table, played.clips, played.notes),
        tables="".join(
            f"<details{' open' * (k == 0)}><summary>{html.escape(label(condition, table.conditions))}</summary>"
            f"{condition_table(table, k)}</details>"
            for k, condition in enumerate(table.conditions)
        ),
        methods=f"<h2>{METHODS_TITLE}</h2>{definitions(table.methods)}" if table.methods else "",
        counted=f"<h2>{COUNTS_TITLE}</h2>{definitions(table.counted)}" if table.counted else "",
        failures=failures(table),
        meaning=definitions({name: each.definition for name, each in all_metrics().items() if name in (*shown, BYTES)}),
        settings=definitions(about.settings),
        command=f"<pre>{html.escape(about.command)}</pre>" if about.command else "",
    )


def _summary(table: ResultTable) -> str:
    counts = (
        (len(table.policies), "policy", "policies"),
        (len(table.conditions), "condition", "conditions"),
        (len(table.seeds), "seed", "seeds"),
    )
    grid = " x ".join(f"{count} {one if count == 1 else many}" for count, one, many in counts)
    if table.samples.are_places:
        grid += f" in {'one place' if table.samples.places == 1 else f'{table.samples.places} places'}"
    faults = ((len(table.failures), "failed"), (table.missing, "not run"))
    state = "".join(f", {count} {word}" for count, word in faults if count)
    length = f"{table.frames} frames each" if table.frames else "whole episodes"
    return f"{grid}, {length}: {int(table.finished.sum())} runs finished{state}"


def _interval_note(table: ResultTable) -> str:
    samples = table.samples
    if samples.count == 1:
        alone = f"There is {samples.text}, and so no interval: what another would give is not known."
        return f"{alone} {table.caution}".rstrip()
    meaning = f"± and whiskers are 95 % intervals of the mean over {samples.text}, by {interval_kinds(table.shown)}"
    if samples.are_places and samples.count < len(table.seeds):
        meaning += "; a place counts once, with the mean of its seeds"
    if samples.in_one_place:
        meaning += "; what another place would give is not known"
    return f"{meaning}; whiskers end where the scale does. {table.caution}".rstrip()


def _clips(table: ResultTable, clips: Sequence[Clip], notes: Sequence[str]) -> str:
    if not clips and not notes:
        return ""
    parts = []
    for k, clip in enumerate(clips):
        moment = clip.moment
        cell = moment.worst.cell
        where = f"{label(cell.condition, table.conditions)}, seed {cell.seed}"
        names = [html.escape(result.cell.policy) for result in (moment.worst, moment.best)]
        means = [f"{result.rewards[moment.first : moment.last].mean():.2f}" for result in (moment.worst, moment.best)]
        panels = "".join(
            f'<div><b>{name}</b> <span class="dim">reward {mean}</span>'
            f'<canvas data-run="{run}" role="img" aria-label="{name} from above"></canvas></div>'
            for run, (name, mean) in enumerate(zip(names, means, strict=True))
        )
        caption = f"{html.escape(where)}, tracks of {html.escape(clip.agent)}"
        parts.append(
            f'<figure class="clip" data-clip="{k}"><figcaption>{names[0]} against {names[1]}: {caption}</figcaption>'
            f'<div class="pair">{panels}</div><div class="player"><button>Play</button><input type="range" min="0" '
            'value="0" aria-label="frame" autocomplete="off"><output></output></div></figure>'
        )
    listed = "".join(f'<p class="note">{html.escape(note)}</p>' for note in notes)
    legend = keys_html(SCENE) if clips else ""
    return f"<section><h2>Worst moments</h2>{_CLIPS_NOTE}{legend}{''.join(parts)}{listed}</section>"


def _data(table: ResultTable, played: Played) -> dict[str, Any]:
    axes = varying_axes(table.conditions)
    texts = [values_of(axis, table.conditions) for axis in axes]
    values = [list(each) for each in texts]
    scenarios = table.scenarios
    metrics = [*table.shown, *([BYTES] if BYTES in table.metrics else [])]
    return {
        "policies": list(table.names.values()),
        "scenarios": scenarios,
        "metrics": [{"name": name, "less": less_is_better(name)} for name in table.shown],
        "axes": [
            {
                "title": axis.title,
                "label": axis.label,
                "values": list(range(len(each))) if axis.named else [_json(float(value)) for value in each],
                "texts": list(each.values()),
                "named": axis.named,
                "mildest": list(each).index(min(each, key=axis.harm)),
            }
            for axis, each in zip(axes, texts, strict=True)
        ],
        "conditions": [
            {
                "scenario": scenarios.index(condition.scenario),
                "at": [each.index(axis.value(condition)) for axis, each in zip(axes, values, strict=True)],
            }
            for condition in table.conditions
        ],
        "values": {name: _intervals(table, name) for name in metrics},
        "bytes": BYTES,
        "drawing": dict(DRAWING),
        "clips": [clip.data() for clip in played.clips],
        "pairs": [*map(pair_data, played.pairs), *map(lie_data, played.lies)],
    }


def _intervals(table: ResultTable, metric: str) -> list[list[list[float | None]]]:
    """Return mean, low and high, by policy and condition."""
    rows = []
    for policy in table.values(metric):
        intervals = [table.interval(metric, seeds) for seeds in policy]
        rows.append([[_json(value) for value in (each.mean, each.low, each.high)] for each in intervals])
    return rows


def _json(value: float) -> float | None:
    """Round to five digits; None for numbers that JSON does not have."""
    return float(f"{value:.5g}") if math.isfinite(value) else None
