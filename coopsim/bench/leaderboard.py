"""Ranking of policies on a set of recordings: tables as Markdown and CSV, and MOTA over recall as a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.evaluate import RecordingsEvaluation, evaluate_recordings, replay_keywords
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.text.bench_text import METHODS_TITLE
from coopsim.bench.text.forms import columns, format_value, to_csv_text
from coopsim.bench.text.score_text import score_row
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.metrics.clear import RECALL_POINTS
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.metrics.score import Score
from coopsim.provided import listening_env
from coopsim.support.files import make_folder, write_whole
from coopsim.viz.charts import PAGE_IN, Look, fit_beside, label_ends, legend_below, policy_styles, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Results = Mapping[str, RecordingsEvaluation]
"""Evaluations by policy."""

_PROTOCOLS = {"count": "false positives counted", "ignore": "false positives ignored"}


def evaluate_each(
    path: str | Path,
    detections: Sequence[str] | None,
    policies: Sequence[str],
    *,
    isolation: Isolation = Isolation(),  # noqa: B008  (frozen)
    **options: Any,
) -> Iterator[tuple[str, RecordingsEvaluation | Exception]]:
    """Run policies over a set of recordings, and yield each one's name with its evaluation or exception.

    All policies and environments are made once before the first run, so that a mistake in the last costs no run.
    Arguments are those of `evaluate_recordings`, the same for all policies.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted, before any run; or a file is broken, from the
            iterator.
    """
    of_environment = {name: value for name, value in options.items() if name != "sequences"}
    replayed = replay_keywords(path, detections, of_environment)
    isolation.require(options)
    specs = {name: PolicySpec.parse(name) for name in policies}
    for spec in specs.values():
        with isolation.described(spec) as policy:
            if policy.needs.truth:
                raise InvalidValueError(
                    f"policies must compete, got {spec.text!r}, which is told the truth: it is an upper bound"
                )
            listening_env("replay", policy, replayed).close()

    def evaluated(spec: PolicySpec) -> RecordingsEvaluation:
        with isolation.policy(spec) as policy:
            return evaluate_recordings(policy, path, detections, seed=isolation.seed(0), **options)

    return ((name, _evaluation_or_error(partial(evaluated, spec))) for name, spec in specs.items())


def _evaluation_or_error(evaluate: Callable[[], RecordingsEvaluation]) -> RecordingsEvaluation | Exception:
    try:
        return evaluate()
    except RecordingError:
        raise
    except Exception as error:  # a user's policy may raise anything, and the others go on
        return error


def rows_of(results: Results) -> list[dict[str, Any]]:
    """Return a row per policy and protocol: `policy`, `false positives`, and the values by column."""
    return [
        {
            "policy": name,
            "false positives": protocol,
            **score_row(getattr(result, protocol), result.frames_per_s),
        }
        for protocol in _PROTOCOLS
        for name, result in results.items()
    ]


def to_markdown(results: Results, title: str) -> str:
    """Format two tables, false positives counted and ignored, by the primary metric, and what method each policy is."""
    shown = columns()
    parts = [f"# {title}\n"]
    for protocol, heading in _PROTOCOLS.items():
        rows = [row for row in rows_of(results) if row["false positives"] == protocol]
        rows.sort(key=lambda row: _place(row[PRIMARY_METRIC]))
        cells = [[row["policy"], *(format_value(row[name], form) for name, form in shown)] for row in rows]
        heads, align = ["policy", *(name for name, _ in shown)], ["left", *["right"] * len(shown)]
        table = tabulate(cells, heads, tablefmt="github", colalign=align, disable_numparse=True)
        parts.append(f"## {heading.capitalize()}\n\n{table}\n")
    methods = [f"- {name}: {result.method}\n" for name, result in results.items() if result.method]
    if methods:
        parts.append(f"## {METHODS_TITLE}\n\n" + "".join(methods))
    return "\n".join(parts)


def to_csv(results: Results) -> str:
    """Format all rows as CSV, unrounded."""
    return to_csv_text(rows_of(results))


def mota_over_recall(score: Score) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the levels of recall (K,) and MOTA there (K,) in per cent, mean over the agents that reach the level."""
    total, reached = np.zeros(RECALL_POINTS + 1), np.zeros(RECALL_POINTS + 1)
    for agent in score.agents.values():
        for point in agent.sweep.points if agent.sweep is not None else ():
            level = round(point.recall * RECALL_POINTS)
            total[level] += 100 * point.clear.mota
            reached[level] += 1
    levels = np.flatnonzero(reached)
    return levels / RECALL_POINTS, total[levels] / reached[levels]


def _place(value: float) -> float:
    """Return the key that sorts values, the best first and those that are undefined last."""
    return math.inf if math.isnan(value) else -value


def plot(results: Results, title: str) -> str:
    """Plot MOTA over recall as SVG, with a panel for each protocol and a line for each policy."""
    styles = policy_styles(list(results))

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, 2, sharey=True)
        ends: list[tuple[str, Look, float, float]] = []
        for panel, (protocol, heading) in zip(axes, _PROTOCOLS.items(), strict=True):
            curves = {name: mota_over_recall(getattr(each, protocol)) for name, each in results.items()}
            for name, curve in curves.items():
                panel.plot(*curve, **{**styles[name].matplotlib, "marker": ""})
            panel.set(title=heading, xlabel="recall", xlim=(0, 1))
            known = {name: curve for name, curve in curves.items() if len(curve[0])}
            ends = [(name, styles[name], float(x[-1]), float(y[-1])) for name, (x, y) in known.items()]
        axes[0].set_ylim(max(-20, axes[0].get_ylim()[0]), axes[0].get_ylim()[1])
        axes[0].set_ylabel("MOTA (%)")
        if fit_beside(list(results)):
            label_ends(axes[1], ends, 2.2)
        else:
            legend_below(figure, styles)
        figure.suptitle(title)

    return to_svg(draw, PAGE_IN, 3.2)


def write_leaderboard(folder: Path, results: Results, title: str) -> tuple[Path, ...]:
    """Write `leaderboard.md`, `leaderboard.csv` and `leaderboard.svg`.

    Raises:
        InvalidValueError: there are no results, or the folder cannot be written.
    """
    if not results:
        raise InvalidValueError("a leaderboard needs at least one policy")
    make_folder(folder)
    contents = {"md": to_markdown(results, title), "csv": to_csv(results), "svg": plot(results, title)}
    return tuple(write_whole(folder / f"leaderboard.{kind}", text) for kind, text in contents.items())
