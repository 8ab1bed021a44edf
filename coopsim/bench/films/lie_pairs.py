"""Pairs with a lie: the same seed while all are honest and while somebody lies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from coopsim.bench.films.choice import Films, telling
from coopsim.bench.films.film import Film, FilmFrame, Rows, boxes_of
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.results.result_table import ResultTable
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.metrics.built_in import less_is_better
from coopsim.metrics.deception_log import near
from coopsim.types import NS_PER_S

_DRIVEN = ("crash", "phantom_brakes", "hard_brakes", "time_lost")
"""Metrics of driven cars in which a lie can cost, the gravest first."""

_LEAD_S, _SHOWN_S = 1.0, 10.0
"""Time shown before the lie tells on its receiver, and after that."""


@dataclass(frozen=True, slots=True, eq=False)
class LiePair:
    """Two runs in the same world.

    Attributes:
        honest: the run in which all are honest.
        attacked: the run in which somebody lies.
        metric: metric in which the lie made the run worse.
        receiver: the honest agent whose value of that metric it made worst.
    """

    honest: CellResult
    attacked: CellResult
    metric: str
    receiver: str


@dataclass(frozen=True, slots=True, eq=False)
class FilmedLie:
    """The pictures of a pair, from shortly before the lie tells on the receiver.

    Attributes:
        pair: the pair.
        honest: film of the honest run.
        attacked: film of the other one.
        first: number of the first frame that is shown.
        last: number of the frame after the last one.
        begins_s: time at which the lie begins.
        believed_s: time of the receiver's first track on a claimed object that is not there; None: it has none.
        lost_s: time of the first denied object without a track of the receiver; None: there is none.
        crash_s: time of the last frame that was filmed, before a crash; None: the run does not end in one.
    """

    pair: LiePair
    honest: Film
    attacked: Film
    first: int
    last: int
    begins_s: float
    believed_s: float | None
    lost_s: float | None
    crash_s: float | None = None


def lie_pairs(table: ResultTable, count: int) -> tuple[LiePair, ...]:
    """Choose at most `count` pairs in which a lie costs most, varied in policy, attack and scenario.

    The cost is the loss in the first metric that the table shows; where cars are driven, in crashes, then in brakes and
    time. Pairs in which it is none are left out, and so are upper bounds. An attack in a scenario with a seed is there
    once.
    """
    if not any(condition.attacks for condition in table.conditions):
        return ()
    driven = [name for name in _DRIVEN if name in table.metrics] if _DRIVEN[0] in table.metrics else []
    pairs: list[LiePair] = []
    for metric in driven or table.shown[:1]:
        pairs += _costly(table, metric, count - len(pairs), {_event(each) for each in pairs})
    return tuple(pairs)


def _event(pair: LiePair) -> tuple[str, str, int]:
    where = pair.attacked.cell.condition
    return where.scenario, where.attacks, pair.attacked.cell.seed


def _costly(table: ResultTable, metric: str, count: int, known: set[tuple[str, str, int]]) -> list[LiePair]:
    """Choose at most `count` pairs in which a lie costs most in a metric, of other events than are known."""
    runs = dict(zip(table.places, table.results, strict=True))
    weights = _losses(table, metric)
    attacks = np.array([condition.attacks for condition in table.conditions])
    scenarios = np.array([condition.scenario for condition in table.conditions])
    for scenario, lie, seed in known:
        weights[:, (scenarios == scenario) & (attacks == lie), table.seeds.index(seed)] = 0.0

    def alike(place: tuple[int, ...]) -> tuple[Any, list[Any]]:
        policy, condition, seed = place
        lie, here = attacks == attacks[condition], scenarios == scenarios[condition]
        return np.s_[:, lie & here, seed], [np.s_[policy], np.s_[:, lie], np.s_[:, here], np.s_[:, :, seed]]

    def pair(policy: int, condition: int, seed: int) -> LiePair | None:
        honest = table.conditions.index(table.conditions[condition].changed(attacks=""))
        return _pair(runs[policy, honest, seed], runs[policy, condition, seed], metric)

    found = (pair(*place) for place in telling(weights, alike))
    return list(islice((each for each in found if each is not None), count))


def _losses(table: ResultTable, metric: str) -> Floats:
    """Return the loss (P, C, S) of each run against its honest twin; 0 where there is none."""
    values = -table.values(metric) if less_is_better(metric) else table.values(metric)
    losses = np.zeros(values.shape)
    for k, condition in enumerate(table.conditions):
        twin = condition.changed(attacks="")
        if condition.attacks and twin in table.conditions:
            losses[:, k] = np.nan_to_num(values[:, table.conditions.index(twin)] - values[:, k])
    losses[[k for k, name in enumerate(table.policies) if name in table.bounds]] = 0.0
    return losses


def _pair(honest: CellResult, attacked: CellResult, metric: str) -> LiePair | None:
    """Return the pair as the honest agent sees it that loses most; None where no agent has values."""
    sign = -1.0 if less_is_better(metric) else 1.0
    liars = attacks_by_agent(attacked.cell.condition.attacks)
    losses = {
        name: sign * (values.get(metric, math.nan) - attacked.agents.get(name, {}).get(metric, math.nan))
        for name, values in honest.agents.items()
        if name not in liars
    }
    known = {name: loss for name, loss in losses.items() if math.isfinite(loss)}
    if not known:
        return None
    return LiePair(honest, attacked, metric, max(known, key=lambda name: known[name]))


def filmed_lies(pairs: Sequence[LiePair], films: Films) -> list[FilmedLie]:
    """Return the pairs whose films can be read, cut to where the lie tells on the receiver."""
    known = ((pair, films.of(pair.honest, pair.attacked)) for pair in pairs)
    cut = [_cut(pair, *both) for pair, both in known if both is not None]
    return [each for each in cut if each is not None]


def _cut(pair: LiePair, honest: Film, attacked: Film) -> FilmedLie | None:
    begin = next((k for k, frame in enumerate(attacked.frames) if frame.lies), None)
    if begin is None:
        return None
    tells = _tells(honest, attacked, begin, pair.receiver)
    first = max(tells - round(_LEAD_S / attacked.dt_s), 0)
    last = tells + round(_SHOWN_S / attacked.dt_s) + 1
    return FilmedLie(
        pair,
        honest,
        attacked,
        first,
        min(last, max(len(honest.frames), len(attacked.frames))),
        attacked.frames[begin].time_ns / NS_PER_S,
        _first_s(attacked, lambda frame: _is_tracked(frame, pair.receiver)),
        _first_s(attacked, lambda frame: _is_lost(frame, pair.receiver)),
        attacked.frames[-1].time_ns / NS_PER_S if pair.attacked.values.get(_DRIVEN[0]) else None,
    )


def _tells(honest: Film, attacked: Film, begin: int, receiver: str) -> int:
    """Return the frame from `begin` on in which the lie tells on the receiver, or `begin` if it never does.

    It does where the receiver tracks what is claimed, or has no track on what is denied although it has one while all
    are honest.
    """
    for k in range(begin, len(attacked.frames)):
        lied = attacked.frames[k]
        if _is_tracked(lied, receiver):
            return k
        told = replace(honest.frames[k], lies=lied.lies) if k < len(honest.frames) else lied
        if _is_lost(lied, receiver) and not _is_lost(told, receiver):
            return k
    return begin


def _first_s(film: Film, holds: Callable[[FilmFrame], bool]) -> float | None:
    return next((frame.time_ns / NS_PER_S for frame in film.frames if holds(frame)), None)


def _is_tracked(frame: FilmFrame, receiver: str) -> bool:
    claimed = boxes_of(joined(each.claimed for each in frame.lies))
    made_up = claimed[~near(claimed, boxes_of(frame.truth))]
    return receiver in frame.tracks and bool(near(made_up, boxes_of(frame.tracks[receiver])).any())


def _is_lost(frame: FilmFrame, receiver: str) -> bool:
    denied = boxes_of(joined(each.denied for each in frame.lies))
    true = denied[near(denied, boxes_of(frame.truth))]
    return receiver in frame.tracks and not near(true, boxes_of(frame.tracks[receiver])).all()


def joined(parts: Iterable[Rows]) -> Rows:
    """Return the boxes of all lies of a frame, numbered anew."""
    rows = np.concatenate([np.zeros((0, 6), np.int32), *parts])
    rows[:, 0] = np.arange(len(rows))
    return rows
