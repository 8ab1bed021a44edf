"""Pairs with a lie in a report: the honest and the attacked run side by side, with the lie in a colour of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from coopsim.bench.films.film import Film, ShownLie
from coopsim.bench.films.lie_pairs import FilmedLie, LiePair, joined
from coopsim.bench.grid.labels import label
from coopsim.bench.report.film_data import frame_data, home_of, map_data, place_data, rows_data, run_data
from coopsim.bench.report.film_section import Figure, Panel
from coopsim.bench.report.keys import SCENE
from coopsim.bench.report.space_data import pair_view
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.forms import form_of
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S

NOTE = """The same seed while all are honest (left) and while somebody lies (right): the pairs in
which the lie costs most. Both show the points, the tracks and the arriving messages of one honest receiver, from a
second before the lie tells on it, for ten seconds. Click a moment to see it."""

KEYS = (*SCENE, "told", "claimed", "denied", "stated")

_SPAN_M = 80


def lie_figure(filmed: FilmedLie, table: ResultTable) -> Figure:
    """Return a pair as a figure, which the page's script plays as it plays pairs of crashes."""
    pair, attacked = filmed.pair, filmed.attacked
    cell, honest = pair.attacked.cell, [each.changed(attacks="") for each in table.conditions]
    where = f"{label(cell.condition.changed(attacks=''), honest)}, seed {cell.seed}, {cell.policy}"
    panels = [Panel("Honest", "", ()), Panel("Attacked", cell.condition.attacks, _moments(filmed))]
    home = home_of(attacked.frames)
    data = {
        "agent": pair.receiver,
        "start_s": round(attacked.frames[filmed.first].time_ns / NS_PER_S, 3),
        "dt_s": attacked.dt_s,
        "span": _SPAN_M,
        "map": map_data(attacked.road_map, home),
        "sides": [_side(film, filmed, home) for film in (filmed.honest, attacked)],
    }
    space = pair_view(["Honest", "Attacked"], [filmed.honest, attacked], pair.receiver, filmed.first, filmed.last)
    return Figure(f"{where}: {_cost(pair)}", panels, data, space)


def _cost(pair: LiePair) -> str:
    """Describe what the lie costs its receiver."""
    lost, kept = (each.agents[pair.receiver][pair.metric] for each in (pair.attacked, pair.honest))
    if pair.metric == "crash":
        return f"{pair.receiver} crashes only under the lie"
    form = form_of(pair.metric)
    return f"{pair.metric.replace('_', ' ')} of {pair.receiver} {kept:{form}}, under the lie {lost:{form}}"


def _moments(filmed: FilmedLie) -> list[tuple[float, str]]:
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
    return [(at_s, f"{at_s:.1f} s {text}") for at_s, text in shown]


def _side(film: Film, filmed: FilmedLie, home: Floats) -> dict[str, Any]:
    receiver, numbers = filmed.pair.receiver, range(filmed.first, min(filmed.last, len(film.frames)))
    frames = [film.frames[k] for k in numbers]
    arrived = [sorted(film.reached(receiver, k) & set(film.frames[k].agents)) for k in numbers]
    return {
        "frames": [frame_data(frame, home, receiver) for frame in frames],
        "runs": [run_data(film, receiver, numbers, home)],
        "marks": [{"met": [], "arrived": each, "crash": False} for each in arrived],
        "lies": [_lies(frame.lies, home) for frame in frames],
    }


def _lies(lies: Sequence[ShownLie], home: Floats) -> dict[str, Any]:
    """Return the lies of a frame: claimed and denied boxes, and each liar with the place (2,) that it states."""
    return {
        "claimed": rows_data(joined(lie.claimed for lie in lies), home),
        "denied": rows_data(joined(lie.denied for lie in lies), home),
        "stated": {lie.agent: None if lie.stated_m is None else place_data(lie.stated_m, home) for lie in lies},
    }
