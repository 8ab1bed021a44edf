"""Pairs with a lie: the same seed while all are honest and while somebody lies, recorded from above."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.report.clips import RunCell, changed_since, pairs_in_time
from coopsim.bench.report.scene import Film
from coopsim.bench.results.result_table import ResultTable
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.metrics.built_in import less_is_better
from coopsim.metrics.deception_log import near
from coopsim.types import NS_PER_S
from coopsim.types.lies import Lie
from coopsim.viz.bev import BevFrame

_REPEATED = 0.5
"""Weight of a pair whose policy, attack or scenario was chosen before, once for each."""

_DRIVEN = ("crash", "phantom_brakes", "hard_brakes", "time_lost")
"""Metrics of driven cars in which a lie can cost, the gravest first."""

_LEAD_S, _SHOWN_S = 1.0, 10.0
"""Time shown before the lie tells on its receiver, and after that."""

_POINTS_SHOWN = 500


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
        honest: film of the honest run: its receiver's points and arrived messages.
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
    pairs: list[LiePair] = []
    while len(pairs) < count and weights.max(initial=0.0) > 0:
        policy, condition, seed = (int(k) for k in np.unravel_index(weights.argmax(), weights.shape))
        honest = table.conditions.index(table.conditions[condition].changed(attacks=""))
        pair = _pair(runs[policy, honest, seed], runs[policy, condition, seed], metric)
        pairs += [] if pair is None else [pair]
        same = attacks == attacks[condition], scenarios == scenarios[condition]
        weights[:, same[0] & same[1], seed] = 0.0
        for chosen in (np.s_[policy], np.s_[:, same[0]], np.s_[:, same[1]], np.s_[:, :, seed]):
            weights[chosen] *= _REPEATED
    return pairs


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


def film_lies(
    pairs: Sequence[LiePair], run: RunCell, time_limit_s: float, clock: Callable[[], float] = time.monotonic
) -> tuple[list[FilmedLie], list[str]]:
    """Run the cells of pairs again and record them; none is begun after `time_limit_s`.

    Return the films, and a line for each pair that could not be recorded.
    """
    filmed, notes = list[FilmedLie](), list[str]()
    known: dict[tuple[Cell, str], Film | str] = {}
    for pair in pairs_in_time(pairs, time_limit_s, clock, notes):
        for result in (pair.honest, pair.attacked):
            key = result.cell, pair.receiver
            if key not in known:
                known[key] = _shoot(result, pair.receiver, run)
        honest, attacked = (known[result.cell, pair.receiver] for result in (pair.honest, pair.attacked))
        if isinstance(honest, str) or isinstance(attacked, str):
            notes += [each for each in (honest, attacked) if isinstance(each, str)]
        elif any(frame.lies for frame in attacked.frames):
            filmed.append(_cut(pair, honest, attacked))
    return filmed, notes


def _shoot(result: CellResult, receiver: str, run: RunCell) -> Film | str:
    """Record a run as a receiver knows it, or return why that failed."""
    film, cell = Film(_POINTS_SHOWN, receiver), result.cell
    again = run(cell, film)
    name = f"{cell.policy}, {cell.condition.attacks or 'all honest'}, seed {cell.seed}"
    return changed_since(name, again, result.rewards) or film


def _cut(pair: LiePair, honest: Film, attacked: Film) -> FilmedLie:
    begin = next(k for k, frame in enumerate(attacked.frames) if frame.lies)
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


def _first_s(film: Film, holds: Callable[[BevFrame], bool]) -> float | None:
    return next((frame.time_ns / NS_PER_S for frame in film.frames if holds(frame)), None)


def _is_tracked(frame: BevFrame, receiver: str) -> bool:
    claimed = joined(frame.lies, lambda lie: lie.claimed)
    made_up = claimed[~near(claimed, frame.actors.boxes)]
    return receiver in frame.tracks and bool(near(made_up, frame.tracks[receiver].boxes).any())


def _is_lost(frame: BevFrame, receiver: str) -> bool:
    denied = joined(frame.lies, lambda lie: lie.denied)
    true = denied[near(denied, frame.actors.boxes)]
    return receiver in frame.tracks and not near(true, frame.tracks[receiver].boxes).all()


def joined(lies: Sequence[Lie], of: Callable[[Lie], Boxes3D]) -> Boxes3D:
    """Return the boxes of all lies of a frame in one, in the world frame."""
    return Boxes3D.concatenate(of(lie) for lie in lies)
