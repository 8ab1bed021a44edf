"""The question that a benchmark asked, and its answer in sentences: the top of a report."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.bench.films.crash_pairs import CRASH, policy_alone
from coopsim.bench.grid.axis import ATTACKS
from coopsim.bench.grid.labels import varying_axes
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.standings import compare_with_best
from coopsim.bench.safety.lie_costs import COSTS, attacked, lie_costs
from coopsim.bench.safety.paired import (
    Change,
    Pairing,
    by_sample,
    by_world,
    calm,
    change,
    changes_along,
    compare_runs,
    is_gain,
    kinds_of,
)
from coopsim.bench.text.forms import difference_text, form_of, format_value, interval_beside
from coopsim.metrics.built_in import BYTES, all_metrics, is_yes_no, less_is_better

_FOUND = ("APBEV", "mAP", "AP")  # how metrics of detection begin
_OTHERS = 4  # names in a sentence
_STEPS = 3  # numbers in it
_LEAST_P = 0.05  # above it a difference is not shown


@dataclass(frozen=True, slots=True)
class Answer:
    """A question with its answer.

    Attributes:
        question: one sentence.
        verdict: the answer in one sentence, with its interval.
        points: headings with a sentence each, on costs, limits and lies.
    """

    question: str
    verdict: str
    points: tuple[tuple[str, str], ...] = ()

    def html(self) -> str:
        """Return the answer as a section of a page, without the question, which is the page's title."""
        rows = "".join(f"<dt>{html.escape(head)}</dt><dd>{html.escape(text)}</dd>" for head, text in self.points)
        return (
            f'<section id="answer"><p>{html.escape(self.verdict)}</p>{f"<dl>{rows}</dl>" if rows else ""}</section>\n'
        )


def answer_of(table: ResultTable) -> Answer | None:
    """Answer in the metric that ranks, where as little disturbs as was run; None without a finished run."""
    metric = next(iter(table.shown), None)
    competing = [k for k, name in enumerate(table.policies) if name not in table.bounds]
    if metric is None or not competing or not np.isfinite(table.values(metric)[competing]).any():
        return None
    alone = policy_alone(table)
    sharing = [k for k in competing if k != alone]
    changes = {k: change(table, k, calm(table), metric, _pairing(metric)) for k in sharing} if alone is not None else {}
    known = {k: found for k, found in changes.items() if found is not None}
    if not known:
        return _ranked(table, metric, competing)
    sign = 1.0 if less_is_better(metric) else -1.0
    best = min(known, key=lambda k: sign * known[k].change.mean)
    shared = _shared(table, metric, best, known)
    if [axis.option for axis in varying_axes(table.conditions)] != [ATTACKS]:
        return shared
    lied = list(_lied(table, metric, best))
    if not lied:
        return shared
    worst = max(lied, key=lambda each: sign * each[1].change.mean)
    points = [("While nobody lies", shared.verdict), *shared.points]
    return Answer("What can a liar do?", _harm(*worst, metric, _harmful(table, best)), tuple(points))


def _pairing(metric: str) -> Pairing:
    """Return what a pair is: an episode of a metric that says yes or no, else a sample, as `coopsim compare` has it."""
    return by_world if is_yes_no(metric) else by_sample


def _shared(table: ResultTable, metric: str, best: int, known: dict[int, Change]) -> Answer:
    """Answer whether messages help, by the policy that they help most."""
    found, alone = known[best], policy_alone(table)
    assert alone is not None, "there is a change"
    policy = found.policy + f", the best of {len(known)} policies," * (len(known) > 1)
    points = [
        *_kinds(table, metric, best),
        *_pair("Other policies", _others(table, metric, best, known)),
        *_pair("What it costs", "; ".join(_costs(table, best))),
        *_limits(table, metric, best),
        *_pair("What a liar does", "; ".join(_lies(table, metric, best))),
    ]
    if metric == CRASH:
        question = "Do messages prevent crashes?"
        text = f"with {policy} the car crashes in {found.sharing:.0f} % instead of {found.alone:.0f} % of "
        text += f"{found.pairs} episodes: {_crashes(found.less)} avoided, {found.more} caused, a difference of "
        text += f"{difference_text(found.change, '.0f')} points"
    else:
        question, form = f"Do messages help to {_deed(metric)}?", form_of(metric)
        text = f"with {policy} {metric} is {format_value(found.sharing, form)}, without messages "
        text += f"({table.policies[alone]}) {format_value(found.alone, form)}: {difference_text(found.change, form)}"
        text += f" over {table.samples.text}" * (found.pairs > 1)
    begin = _verdict(found, metric, len(known)) if found.pairs > 1 else f"In {table.samples.text}, which shows little"
    return Answer(question, f"{begin}: {text}.", tuple(points))


def _crashes(count: int) -> str:
    return f"{count} crash{'es' * (count != 1)}"


def _kinds(table: ResultTable, metric: str, policy: int) -> Iterator[tuple[str, str]]:
    """Yield what messages change in drives as traffic has them, and in those made to need messages."""
    for kind, conditions in kinds_of(table) if metric == CRASH else ():
        found = change(table, policy, conditions)
        if found is not None:
            text = f"a car alone crashes in {found.alone:.1f} % of {found.pairs} drives, with messages in "
            text += f"{found.sharing:.1f} %: {difference_text(found.change, '.1f')} points"
            yield from _pair(f"Drives {kind}", text)


def _verdict(found: Change, metric: str, compared: int) -> str:
    """Return yes, no, or that it is not shown, for the best of so many policies, whose p-value is corrected for them.

    A few pairs may have an interval without 0, and a p-value that shows nothing.
    """
    low, high = found.change.low, found.change.high
    if low == high == 0:
        return "No"
    if compared * found.p_value > _LEAST_P:
        return "Not shown"
    if is_gain(found, metric):
        return "Yes"
    return "No" if (low > 0 if less_is_better(metric) else high < 0) else "Not shown"


def _deed(metric: str) -> str:
    if metric.startswith(_FOUND):
        return "detect"
    known = all_metrics().get(metric)
    return "track" if known is not None else f"have a better {metric}"


def _others(table: ResultTable, metric: str, best: int, known: dict[int, Change]) -> str:
    """Say how many other policies gain, and which are not shown to be worse than the best."""
    others = [k for k in known if k != best]
    if not others:
        return ""
    gain = [known[k].policy for k in others if is_gain(known[k], metric)]
    if len(others) == 1:
        text = f"a gain is shown of {gain[0]}, too" if gain else f"no gain is shown of {known[others[0]].policy}"
    else:
        text = f"{len(gain)} of {len(others)} others gain, too" if gain else f"no gain is shown of {len(others)} others"
    level = [table.policies[k] for k, each in enumerate(compare_with_best(table, metric, calm(table))) if each.unbeaten]
    return f"{text}; {_listed(level)} not shown to differ from the best" if level else text


def _listed(names: Sequence[str]) -> str:
    some = ", ".join(names[:_OTHERS]) + f" and {len(names) - _OTHERS} more" if len(names) > _OTHERS else _joined(names)
    return f"{some} {'is' if len(names) == 1 else 'are'}"


def _joined(names: Sequence[str]) -> str:
    return " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])


def _costs(table: ResultTable, policy: int) -> Iterator[str]:
    """Yield what an agent sends, and what differs for a driven car besides crashes."""
    rate = float(known_mean(table.values(BYTES)[policy][calm(table)].ravel(), axis=0))
    if math.isfinite(rate):
        yield f"an agent sends {rate / 1e3:,.1f} kB/s" if rate >= 1e3 else f"an agent sends {rate:.0f} bytes/s"
    changes = {name: change(table, policy, calm(table), name) for name in COSTS if CRASH in table.metrics}
    texts = [
        f"{COSTS[name]} {difference_text(found.change, form_of(name))}"
        for name, found in changes.items()
        if found is not None
    ]
    if texts:
        yield f"per episode, compared with driving without messages: {', '.join(texts)}"


def _limits(table: ResultTable, metric: str, policy: int) -> Iterator[tuple[str, str]]:
    """Yield where the gain ends on each axis, while nothing else disturbs."""
    for axis in varying_axes(table.conditions):
        found = changes_along(table, axis, policy, metric, _pairing(metric)) if axis.option != ATTACKS else []
        if len(found) > 1:
            yield f"Under {axis.title}", _limit(found, metric)


def _limit(found: Sequence[tuple[str, Change]], metric: str) -> str:
    form = _form(metric)
    shown = [k for k, (_, each) in enumerate(found) if is_gain(each, metric)]
    told = _telling_steps(len(found), shown)
    steps = ", ".join(f"{difference_text(found[k][1].change, form)} at {found[k][0]}" for k in told)
    if len(shown) == len(found):
        return f"The gain holds: {steps}."
    names = [found[k][0] for k in shown]
    return f"A gain is shown at {_joined(names)} alone: {steps}." if shown else f"No gain is shown: {steps}."


def _telling_steps(count: int, shown: Sequence[int]) -> list[int]:
    """Choose steps along an axis for a sentence: the first, those at which the gain ends, and the last."""
    if count <= _STEPS:
        return list(range(count))
    ends = {shown[-1], shown[-1] + 1} if shown else set()
    return sorted({0, *(each for each in ends if each < count - 1), count - 1})


def _form(metric: str) -> str:
    return ".0f" if is_yes_no(metric) else form_of(metric)


def _lied(table: ResultTable, metric: str, policy: int) -> Iterator[tuple[str, Change]]:
    """Yield each attack with what it changes, against the same runs while nobody lies."""
    values, pairs = table.values(metric)[policy], _pairing(metric)
    for attack, honest, conditions in attacked(table):
        before, after = (pairs(table, values, each) for each in (honest, conditions))
        found = compare_runs(table.policies[policy], before, after, metric)
        if found is not None:
            yield attack, found


def _lies(table: ResultTable, metric: str, policy: int) -> Iterator[str]:
    costs = _harmful(table, policy)
    for attack, found in _lied(table, metric, policy):
        unit = " points" * is_yes_no(metric)
        text = f"with {attack} {metric} changes by {difference_text(found.change, _form(metric))}{unit}"
        yield ", ".join([text, *costs.get(attack, ())])


def _harmful(table: ResultTable, policy: int) -> dict[str, list[str]]:
    """Return by attack what a lie is shown to cost a driven car besides crashes."""
    found = {each.attack: each.costs for each in lie_costs(table) if each.policy == table.policies[policy]}
    return {
        attack: [
            f"{COSTS[name]} {difference_text(each.change, form_of(name))}"
            for name, each in costs.items()
            if (each.change.low > 0 if less_is_better(name) else each.change.high < 0)
        ]
        for attack, costs in found.items()
    }


def _harm(attack: str, found: Change, metric: str, costs: Mapping[str, Sequence[str]]) -> str:
    """Say what the worst attack does to the policy that messages help most."""
    form, difference = _form(metric), difference_text(found.change, _form(metric))
    harms = found.change.low > 0 if less_is_better(metric) else found.change.high < 0
    begin = "It does harm" if harms else "No harm is shown"
    costly = next(((name, texts) for name, texts in costs.items() if texts), None)
    if costly and not harms:
        return f"No more crashes are shown, but under {costly[0]} the car pays: {_joined(costly[1])} an episode."
    if metric != CRASH:
        values = f"{metric} is {format_value(found.sharing, form)} instead of {format_value(found.alone, form)}"
        return f"{begin}: under {attack}, {values} with {found.policy}, a difference of {difference}."
    rates = f"crashes in {found.sharing:.0f} % instead of {found.alone:.0f} % of {found.pairs} episodes"
    counts = f"{_crashes(found.more)} caused, {found.less} avoided, a difference of {difference} points"
    return f"{begin}: under {attack}, the car {rates} with {found.policy}: {counts}."


def _ranked(table: ResultTable, metric: str, competing: Sequence[int]) -> Answer:
    """Answer which policy is best, or how good the only one is."""
    conditions = calm(table)
    means = {k: table.mean(metric, k, conditions) for k in competing}
    known = [k for k in competing if not math.isnan(means[k].mean)]
    if not known:
        known, conditions = list(competing), list(range(len(table.conditions)))
        means = {k: table.mean(metric, k, conditions) for k in competing}
    sign = 1.0 if less_is_better(metric) else -1.0
    best, form = min(known, key=lambda k: sign * means[k].mean), form_of(metric)
    value = f"{format_value(means[best].mean, form)} {interval_beside(means[best], form)}".rstrip()
    text = f"{table.policies[best]} has a {metric} of {value} over {table.samples.text}."
    costs = _pair("What it costs", "; ".join(_costs(table, best)) if BYTES in table.metrics else "")
    if len(competing) == 1:
        return Answer(f"How good is {table.policies[best]}?", text, tuple(costs))
    level = [table.policies[k] for k, each in enumerate(compare_with_best(table, metric, conditions)) if each.unbeaten]
    more = f"{_listed(level)} not shown to differ" if level else "all are shown to be worse"
    return Answer(f"Which policy has the best {metric}?", text, (("Other policies", more), *costs))


def _pair(head: str, text: str) -> list[tuple[str, str]]:
    return [(head, text[0].upper() + text[1:] + ".")] if text else []
