"""`coopsim bench`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.arguments import (
    FAILED,
    INTERRUPTED,
    add_isolation,
    add_options,
    count,
    named_options,
    names,
    numbers,
    policies,
    policy,
    seeds,
    without_flags,
)
from coopsim.cli.report_command import add_report, write_files
from coopsim.errors import CoopsimError
from coopsim.support.checks import require_choice

if TYPE_CHECKING:
    from tqdm import tqdm

    from coopsim.bench.benchmark import Progress
    from coopsim.bench.grid.cell import Condition
    from coopsim.bench.grid.grid import Grid

HELP = "run policies in simulated traffic under latency, loss, noise and narrow channels, with statistics"

_NO_NUMBER = {"--out": 1, "--workers": 1, "--engine": 1, "--address": 1, "--retry-failed": 0}
"""Flags that change no number, with how many words follow them: the command is noted without them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    grid = parser.add_argument_group("grid", "flags replace values of the preset or file")
    add = grid.add_argument
    add("--preset", metavar="NAME", help="quick, latency, pose, loss, bandwidth or paper")
    add("--grid", type=Path, metavar="FILE", help="YAML with these names, underscores for dashes")
    add("--trust", action="store_true", help="run policies that FILE names as module:Class or file.py:Class")
    add("--policies", type=policies, metavar="A,B(x=1)", help="see `list`; all; or module:Class, or file.py:Class")
    add("--policy", type=policy, action="append", default=[], metavar="A", help="one more; may be given several times")
    add("--scenarios", type=names, metavar="A,B", help="names, or paths of scenario files")
    add("--latencies-ms", type=numbers, metavar="0,300")
    add("--losses", type=numbers, metavar="0,0.1", help="probabilities in [0, 1]")
    add("--position-noises-m", type=numbers, metavar="0,0.2")
    add("--heading-noises-deg", type=numbers, metavar="0,0.2")
    add("--pose", choices=("product", "together"), help="each position noise with each of heading, or pairs of them")
    add("--bandwidths-mbit-s", type=numbers, metavar="0.1,inf", help="of the medium that all agents share")
    add("--vary", choices=("product", "one_by_one"), help="all together, or each of the above by itself")
    add("--seeds", type=seeds, metavar="0-4")
    add("--frames", type=count, help="length of each run")
    add("--device", metavar="NAME", help="of networks: cpu, cuda, cuda:1 or auto (default: cpu)")
    add_options(grid, "of the environments, as detector=pointpillars_v2v4real")
    how = parser.add_argument_group("run")
    how.add_argument("--out", type=Path, default=Path("coopsim-bench"), metavar="FOLDER", help="default: %(default)s")
    how.add_argument("--workers", type=count, help="cells at once (default: as many as cores)")
    how.add_argument(
        "--engine", default="local", help="local (processes of this machine) or ray (default: %(default)s)"
    )
    how.add_argument("--address", help="of a Ray cluster (default: RAY_ADDRESS, or this machine alone)")
    add_isolation(how)
    how.add_argument("--retry-failed", action="store_true", help="run failed cells again")
    add_report(parser.add_argument_group("report"))


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from tqdm import tqdm

    from coopsim.bench.benchmark import Engine, benchmark
    from coopsim.bench.grid.grid_file import find_grid
    from coopsim.bench.isolated.isolation import Isolation

    engine = Engine(options.engine, options.workers, options.address)
    given = {"more_policies": options.policy, "trust": options.trust, **_flag_values(options)}
    source = find_grid(options.preset, options.grid, **given)
    grid = source.grid()
    conditions, finished, lost = list(grid.conditions()), 0, 0
    # The remaining time is ours: the bar's own assumes that all cells take equally long.
    shape = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} cells [{elapsed}{postfix}]"
    with tqdm(total=len(grid), disable=None, desc="bench", bar_format=shape) as bar:

        def show(progress: Progress) -> None:
            nonlocal finished, lost
            lost += progress.outcome is not None and progress.outcome.lost
            finished = progress.stored + progress.done  # a hidden bar does not count
            _show(bar, progress, engine.at_once, conditions)

        try:
            _require_metrics(grid, options.metrics, import_policies=options.isolate is None)
            results = benchmark(
                grid,
                options.out,
                engine=engine,
                retry_failed=options.retry_failed,
                command=without_flags(options.typed, _NO_NUMBER),
                isolation=Isolation.of(options.isolate, options.salt),
                on_progress=show,
                on_broken=lambda error: bar.write(f"coopsim: {error}; its cell is run again", file=sys.stderr),
            )
        except CoopsimError as error:
            raise source.blame(error) from error
        except KeyboardInterrupt:
            bar.close()
            stored = f"{finished} of {len(grid)} cells are stored in {options.out}"
            print(f"coopsim: interrupted; {stored}, and the same command goes on from there", file=sys.stderr)
            return INTERRUPTED
    write_files(options.out, results, options, trust=True)  # the grid's policies, which have run already
    failed = sum(result.failed for result in results) - lost
    if lost:
        print(f"coopsim: {lost} of {len(grid)} cells were not run; the same command runs them", file=sys.stderr)
    if failed:
        print(f"coopsim: {failed} of {len(grid)} cells failed; --retry-failed runs them again", file=sys.stderr)
    return FAILED if failed or lost else 0


def _require_metrics(grid: Grid, metrics: Sequence[str], *, import_policies: bool) -> None:
    """Refuse a metric that nobody has registered, now and not after the last cell."""
    from coopsim.bench.policy_spec import PolicySpec
    from coopsim.metrics.built_in import all_metrics

    for text in grid.policies if metrics and import_policies else ():
        PolicySpec.parse(text).policy_class()  # a policy's file may register one
    for name in metrics:
        require_choice("metric", name, all_metrics())


def _flag_values(options: argparse.Namespace) -> dict[str, Any]:
    """Return the attributes of a grid that were given as flags."""
    from coopsim.bench.grid.grid import ATTRIBUTES

    given = {name: getattr(options, name, None) for name in ATTRIBUTES}
    if options.option:
        given["options"] = named_options(options)
    return {name: value for name, value in given.items() if value is not None}


def _show(bar: tqdm[Any], progress: Progress, workers: int, conditions: Sequence[Condition]) -> None:
    if progress.outcome is None:
        bar.initial = bar.n = progress.stored
        bar.refresh()
        return
    if progress.outcome.result.failed:
        from coopsim.bench.grid.axes import label

        cell = progress.outcome.result.cell
        where = f"{cell.policy}, {label(cell.condition, conditions)}, seed {cell.seed}"
        bar.write(f"coopsim: failed: {where}: {progress.outcome.reason}", file=sys.stderr)
    left = "?" if progress.left_s is None else bar.format_interval(progress.left_s / workers)
    bar.set_postfix_str(f"about {left} left", refresh=False)
    bar.update()
