"""Protocol of a benchmark in words: with it, others get the same numbers."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from coopsim.bench.grid.labels import axes_of
from coopsim.bench.paper.provenance import Provenance, TrainingPlaces
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import LEVEL
from coopsim.metrics.built_in import all_metrics
from coopsim.support.arrays import runs_of

_WIDTH = 100


def protocol_text(table: ResultTable, provenance: Provenance, metrics: Sequence[str]) -> str:
    """Write the protocol of results as plain text; it defines `metrics`. Equal results of equal software give equal
    text.
    """
    sections = {
        "Software": _software(table, provenance),
        "World": _world(table, provenance),
        "Conditions": _conditions(table, provenance),
        "What policies see": _seen(provenance),
        "Policies": _policies(table, provenance),
        "Weights": _weights(table, provenance),
        "Metrics": _metrics(table, provenance, metrics),
        "Statistics": _statistics(table),
        "Finished": _finished(table, provenance),
    }
    # A command is to be copied, so it stays on one line.
    command = provenance.command or "coopsim.benchmark, called from Python"
    parts = ["Protocol of a benchmark by coopsim", f"Command\n-------\n{command}"]
    for heading, lines in sections.items():
        if lines:
            parts.append("\n".join([heading, "-" * len(heading), *(_wrapped(line) for line in lines)]))
    return "\n\n".join(parts) + "\n"


def _software(table: ResultTable, provenance: Provenance) -> list[str]:
    named = [f"{name} {number}" for name, number in provenance.software.items()]
    lines = [", ".join(named)] if named else []
    lines += [f"networks multiply in {' and '.join(table.arithmetics)}"] if table.arithmetics else []
    lines += [f"commit {provenance.commit}"] if provenance.commit else []
    return lines + ([f"sources and weights of coopsim: sha256 {provenance.sources}"] if provenance.sources else [])


def _world(table: ResultTable, provenance: Provenance) -> list[str]:
    lines = [
        f"scenarios: {', '.join(table.scenarios)}",
        f"seeds: {_listed(table.seeds)}; each decides traffic, sensing, noise and losses of a run, the same for all "
        "policies",
        f"frames a run: {table.frames or 'until its episode ends'}",
    ]
    drawn = sorted({result.place_seed for result in table.results if result.place_seed is not None})
    lines += [f"drawn places: {_listed(drawn)} (seed of the place of each seed: results.csv)"] if drawn else []
    options = provenance.grid.get("options", {})
    lines += [f"option {name}: {_short(value)}" for name, value in sorted(options.items())]
    return [*lines, "other options: coopsim's defaults"]


def _conditions(table: ResultTable, provenance: Provenance) -> list[str]:
    lines = []
    for axis in axes_of(table.conditions):
        values = sorted({axis.value(condition) for condition in table.conditions}, key=axis.harm)
        if values == [""]:  # as where nobody lies
            continue
        shown = [axis.own_text(value).removesuffix(f" {axis.unit}") for value in values]
        lines.append(f"{axis.heading}: {', '.join(shown)}")
    ways = {
        "product": "every value with every other",
        "one_by_one": "one at a time, all others where they disturb least",
    }
    way = ways.get(str(provenance.grid.get("vary")))
    count = len(table.conditions)
    return [*lines, f"{count} conditions: {way}"] if way and count > 1 else lines


def _seen(provenance: Provenance) -> list[str]:
    """Say what policies on boxes and policies with networks of their own have in common."""
    if not provenance.grid:
        return []
    detector = provenance.grid.get("options", {}).get("detector")
    named = f"the detector {detector}" if isinstance(detector, str) else "the environment's default detector"
    return [
        "All policies of a condition and seed meet the same traffic, sweeps, poses and losses. Policies that track "
        f"boxes get those of {named}; policies with a network of their own look at the same sweeps themselves.",
        *_isolation(provenance.isolation),
    ]


def _isolation(said: Mapping[str, Any]) -> list[str]:
    apart = "each agent of a policy ran in a process of its own, which got its observations alone"
    lines = [apart] if "own processes" in said else []
    salted = "a run's episode is decided by its seed and a secret salt, whose digest is sha256"
    return [*lines, *([f"{salted} {said['salt']}"] if "salt" in said else [])]


def _policies(table: ResultTable, provenance: Provenance) -> list[str]:
    lines = []
    for policy in table.policies:
        sends = provenance.sends.get(policy)
        sent = [] if sends is None else ["sends nothing" if sends == "none" else f"sends {sends}"]
        loads = provenance.weights.get(policy)
        loaded = [f"weights {', '.join(loads)}"] if loads else []
        method = [table.methods[policy]] if policy in table.methods else []
        lines.append(f"{table.names[policy]}: {'; '.join([*sent, *loaded, *method])}".rstrip(": "))
    return lines + [f"left out: {policy}: {reason}" for policy, reason in provenance.left_out.items()]


def _weights(table: ResultTable, provenance: Provenance) -> list[str]:
    if not provenance.digests:
        return []
    lines = [f"of the detector: {', '.join(provenance.sensing)}"] if provenance.sensing else []
    places = {(each.cell.condition.scenario, each.place_seed) for each in table.results if not each.failed}
    for name, digest in provenance.digests.items():
        data: Mapping[str, Any] = provenance.training.get(name, {})
        trained = TrainingPlaces.from_data(data)
        seen = sum(trained.include(*place) for place in places)
        met = f"{seen} of the {len(places)} places here may be among them" if seen else "none of the places here"
        lines.append(f"{name}: {digest}, {trained.text}{f' ({met})' if trained.simulated else ''}")
    return lines


def _metrics(table: ResultTable, provenance: Provenance, metrics: Sequence[str]) -> list[str]:
    known = all_metrics()
    iou = provenance.grid.get("options", {}).get("match_iou", 0.25)
    first = (
        f"A track is on an object if both are of the same class and their 3D IoU is at least {iou:g}; false positives "
        "are counted. Each agent is scored in its own surroundings; values are means over agents."
    )
    return [first, *(f"{name}: {known[name].definition}" for name in metrics if name in known)]


def _statistics(table: ResultTable) -> list[str]:
    lines = [f"Values are means over {table.samples.text}; conditions and scenarios of a seed are averaged first."]
    if table.samples.count > 1:
        lines.append("Intervals: 95 %, of the mean, by Student's t.")
    lines.append(
        "Significance: differences to the best policy of a column, paired by seed or place; p is the share of flips of "
        "signs, of all policies together, in which the studentised difference of any two is as large, so it holds for "
        f"a best one chosen from the same values; significant up to {LEVEL:g}."
    )
    return lines


def _finished(table: ResultTable, provenance: Provenance) -> list[str]:
    # Of a condition or policy that was never run, the results do not know.
    total, known, done = provenance.cells or table.finished.size, len(table.results), int(table.finished.sum())
    return [f"{done} of {total} runs; {len(table.failures)} failed, {total - known} not run"]


def _listed(numbers: Sequence[int]) -> str:
    """Write integers in order, runs of three and more as "0-4"."""
    parts = [f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs_of(sorted(numbers))]
    return ", ".join(parts)


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _wrapped(line: str) -> str:
    parts = textwrap.wrap(line, _WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    return "\n".join(parts)
