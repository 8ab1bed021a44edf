"""Pairs with a lie in a report: the honest and the attacked run side by side, with the lie in a colour of its own."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from coopsim.bench.grid.labels import label
from coopsim.bench.report.bench_text import form_of
from coopsim.bench.report.keys import SCENE, keys_html
from coopsim.bench.report.lie_pairs import FilmedLie, LiePair, joined
from coopsim.bench.report.scene import Film, boxes_data, frame_data, home_of, map_data, tracks_data
from coopsim.bench.results.result_table import ResultTable
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S
from coopsim.types.lies import Lie

_NOTE = """<p class="note">The same seed while all are honest (left) and while somebody lies (right): the pairs in
which the lie costs most. Both show the points, the tracks and the arriving messages of one honest receiver, from a
second before the lie tells on it, for ten seconds. Click a moment to see it.</p>"""

_KEYS = (*SCENE, "told", "claimed", "denied", "stated")


def lies_section(filmed: Sequence[FilmedLie], notes: Sequence[str], table: ResultTable, first: int = 0) -> str:
    """Return the section as HTML; empty without pairs and notes. `first` is the number of its first pair's data."""
    if not filmed and not notes:
        return ""
    figures = "".join(_figure(k, first + k, each, table) for k, each in enumerate(filmed))
    listed = "".join(f'<p class="note">{html.escape(note)}</p>' for note in notes)
    legend = keys_html(_KEYS) if filmed else ""
    return f"<section><h2>Lies</h2>{_NOTE}{legend}{figures}{listed}</section>"


def _figure(number: int, data: int, filmed: FilmedLie, table: ResultTable) -> str:
    pair = filmed.pair
    cell = pair.attacked.cell
    honest = [each.changed(attacks="") for each in table.conditions]
    where = f"{label(cell.condition.changed(attacks=''), honest)}, seed {cell.seed}, {cell.policy}"
    change = _cost(pair)
    panels = "".join(
        f'<div><p><b>{name}</b> <span class="dim">{html.escape(about)}</span></p>'
        f'<canvas data-side="{side}" role="img" aria-label="{name}, from above"></canvas>'
        f'<div class="moments">{_moments(filmed) if side else ""}</div></div>'
        for side, (name, about) in enumerate((("Honest", ""), ("Attacked", cell.condition.attacks)))
    )
    return (
        f'<figure class="clip" data-pair="{data}"><figcaption>{number + 1}. {html.escape(where)}: '
        f'{html.escape(change)}</figcaption><div class="pair">{panels}</div><div class="player"><button>Play</button>'
        '<input type="range" min="0" value="0" aria-label="frame" autocomplete="off"><output></output></div></figure>'
    )


def _cost(pair: LiePair) -> str:
    """Describe what the lie costs its receiver."""
    lost, kept = (each.agents[pair.receiver][pair.metric] for each in (pair.attacked, pair.honest))
    if pair.metric == "crash":
        return f"{pair.receiver} crashes only under the lie"
    form = form_of(pair.metric)
    return f"{pair.metric.replace('_', ' ')} of {pair.receiver} {kept:{form}}, under the lie {lost:{form}}"


def _moments(filmed: FilmedLie) -> str:
    moments = [
        (filmed.begins_s, "the lie begins"),
        (filmed.believed_s, f"{filmed.pair.receiver} tracks what is not there"),
        (filmed.lost_s, f"{filmed.pair.receiver} has no track on what is denied"),
        (filmed.crash_s, f"{filmed.pair.receiver} crashes"),
    ]
    end_s = filmed.attacked.frames[0].time_ns / NS_PER_S + (filmed.last - 1) * filmed.attacked.dt_s
    first_s = filmed.attacked.frames[filmed.first].time_ns / NS_PER_S
    shown = [(at_s, text) for at_s, text in moments if at_s is not None and first_s - 1e-6 <= at_s <= end_s + 1e-6]
    shown.sort(key=lambda each: each[0])  # stable: of one time, the beginning stands first
    return "".join(
        f'<button class="moment" data-s="{at_s:.3f}">{at_s:.1f} s {html.escape(text)}</button>' for at_s, text in shown
    )


def lie_data(filmed: FilmedLie) -> dict[str, Any]:
    """Return plain data of a pair for the page's script, which plays it as it plays pairs of crashes."""
    attacked = filmed.attacked
    home = home_of(attacked.frames)
    return {
        "start_s": round(attacked.frames[filmed.first].time_ns / NS_PER_S, 3),
        "dt_s": attacked.dt_s,
        "map": map_data(attacked.road_map, home),
        "eye": None,  # the receiver's own place, frame by frame
        "sides": [_side(film, filmed, home) for film in (filmed.honest, attacked)],
    }


def _side(film: Film, filmed: FilmedLie, home: Floats) -> dict[str, Any]:
    receiver, numbers = filmed.pair.receiver, range(filmed.first, min(filmed.last, len(film.frames)))
    frames = [film.frames[k] for k in numbers]
    tracks = [tracks_data({n: each for n, each in frame.tracks.items() if n == receiver}, home) for frame in frames]
    marks = [
        {"met": [], "arrived": sorted(film.arrived[k] & set(film.frames[k].agents)), "crash": False} for k in numbers
    ]
    return {
        "agent": receiver,
        "frames": [frame_data(frame, home) for frame in frames],
        "runs": [{"tracks": tracks}],
        "marks": marks,
        "lies": [_lies(frame.lies, home) for frame in frames],
    }


def _lies(lies: Sequence[Lie], home: Floats) -> dict[str, Any]:
    """Return the lies of a frame: claimed and denied boxes, and each liar with the place (2,) that it states."""
    claimed, denied = joined(lies, lambda lie: lie.claimed), joined(lies, lambda lie: lie.denied)
    stated = {lie.agent: None if lie.stated_m is None else (lie.stated_m - home).round(2).tolist() for lie in lies}
    return {
        "claimed": boxes_data(np.arange(len(claimed)), claimed, home),
        "denied": boxes_data(np.arange(len(denied)), denied, home),
        "stated": stated,
    }
