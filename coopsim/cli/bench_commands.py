"""`coopsim bench`, `coopsim report` and `coopsim compare`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.bench.grid.cell import CellResult
from coopsim.cli.argument_types import (
    count,
    count_or_zero,
    environments,
    names,
    numbers,
    policies,
    policy,
    varied,
    varied_option,
)
from coopsim.cli.arguments import (
    FAILED,
    INTERRUPTED,
    NOISES,
    Command,
    add_flags,
    add_old_name,
    add_options,
    add_unneeded,
    as_json,
    detector_option,
    named_options,
    stored_results,
    without_flags,
)
from coopsim.cli.jobs_bar import JobsBar
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.files import require_writable, write_whole

if TYPE_CHECKING:
    from coopsim.bench.grid.grid import Grid


def _add_report(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, metavar="FOLDER", help="of `coopsim bench`")
    add_flags(parser, "--all-grids")
    add_unneeded(parser, "--trust", "nothing is run any more")
    _add_outputs(parser)


def _add_outputs(parser: argparse._ActionsContainer) -> None:
    """Declare what `bench` and `report` write."""
    add = parser.add_argument
    of = "of leaderboards, LaTeX tables and figure; the first ranks"
    add("--metrics", type=names, default=(), metavar="A,B", help=of)
    add("--title", default="", metavar="TEXT", help="of the report (default: the question that the results answer)")
    clips = "of the worst moments, lies and crashes, from films of the runs; 0: none are kept (default: %(default)s)"
    add("--clips", type=count_or_zero, default=5, help=clips)
    add("--plots", action="store_true", help="write the curves of all metrics as SVG files, too")
    add_flags(parser, "--json", help="write means and intervals of each policy and condition here as well")


def _run_report(options: argparse.Namespace) -> int:
    from coopsim.bench.store.store import Store

    results = stored_results(options.out, all_grids=options.all_grids)
    write_files(options.out, results, options)
    asked = Store(options.out).asked()
    if len(results) < asked and not options.all_grids:
        print(f"{len(results)} of {asked} runs are in {options.out}; the command that began them goes on from there")
    return 0


def write_files(folder: Path, results: Sequence[CellResult], options: argparse.Namespace) -> None:
    """Write the files of a folder's results, and print the leaderboard and their paths."""
    from coopsim.bench.paper.provenance import Provenance
    from coopsim.bench.report.publish import publish
    from coopsim.bench.results.result_table import ResultTable
    from coopsim.bench.store.store import Store
    from coopsim.bench.text.bench_text import leaderboard_text, to_rows

    store = Store(folder)
    written = publish(
        folder,
        results,
        Provenance.from_data(store.provenance()),
        circumstances=store.all_circumstances(),
        title=options.title,
        metrics=options.metrics,
        clips=options.clips,
        with_plots=options.plots,
        on_note=lambda note: print(f"coopsim: {note}", file=sys.stderr),
    )
    table = ResultTable.of(results, options.metrics)
    print(leaderboard_text(table, options.metrics))
    if options.json is not None:
        written = (*written, write_whole(options.json, as_json(to_rows(table))))
    for path in written:
        print(f"written: {path}")


REPORT = Command(
    "write the report, tables and figures of a benchmark's folder again, finished or not",
    _add_report,
    _run_report,
    ("coopsim report coopsim-bench --metrics HOTA,AMOTA --plots",),
)


_NO_NUMBER = {
    **dict.fromkeys(("--out", "--workers", "--engine", "--address", "--json"), 1),
    **dict.fromkeys(("--retry-failed", "--retry-unfilmed", "--film-3d"), 0),
}
"""Flags that change no number, with how many words follow them: the command is noted without them."""


def _add_bench(parser: argparse.ArgumentParser) -> None:
    grid = parser.add_argument_group("grid", "flags replace values of the preset or file")
    add = grid.add_argument
    presets = (
        "quick, latency, pose, loss, bandwidth, paper, safety, driving, lies, leaderboard, ...: see `list presets`"
    )
    add("--preset", metavar="NAME", help=presets)
    add("--grid", type=Path, metavar="FILE", help="YAML with these names, underscores for dashes")
    add("--trust", action="store_true", help="run code that FILE names as module:Class or file.py:Class")
    add("--policies", type=policies, metavar="A,B(x=1)", help="see `list`; all; or module:Class, or file.py:Class")
    add("--policy", type=policy, action="append", default=[], metavar="A", help="one more; may be given several times")
    of = "names, also with options, or paths of scenario files"
    worlds = add("--environments", type=environments, dest="scenarios", metavar="A,B.yaml", help=of)
    add_old_name(grid, "--scenarios", worlds)
    add("--latencies-ms", type=numbers, metavar="0,300", help="delays of every message (default: 0)")
    add("--losses", type=numbers, metavar="0,0.1", help="probabilities that a message is lost (default: 0)")
    add_flags(grid, *NOISES)
    add("--bandwidths-mbit-s", type=numbers, metavar="0.1,inf", help="rates of the shared medium (default: inf)")
    add("--penetrations", type=numbers, metavar="0.1,1", help="shares of the other cars that are connected")
    add_flags(
        grid, "--attack", help="agents that lie, as one condition; several times: several, of which `none` is honest"
    )
    of = "an axis: any option of environments, or policy.x; several times: several. product or one_by_one: all or each"
    add("--vary", type=varied_option, action="append", default=[], metavar="NAME=A,B", help=of)
    add_flags(grid, "--seeds", help="an episode each (default: 0)")
    add("--frames", type=_frames, metavar="N", help="of each run (default: 100); episode: until its episode ends")
    add_flags(grid, "--detector")
    add_flags(grid, "--device", default=None)
    add_options(grid, "of the environments, such as lidar=VLP-16")
    how = parser.add_argument_group("run")
    add = how.add_argument
    add("--out", type=Path, default=Path("coopsim-bench"), metavar="FOLDER", help="default: %(default)s")
    add_flags(how, "--workers", help="runs at once (default: as many as cores)")
    add("--engine", default="local", help="local (processes of this machine) or ray (default: %(default)s)")
    add("--address", help="of a Ray cluster (default: RAY_ADDRESS, or this machine alone)")
    add_flags(how, "--isolate", "--salt-fd", "--dry-run")
    add("--retry-failed", action="store_true", help="repeat runs that failed")
    add("--retry-unfilmed", action="store_true", help="repeat runs that lack a film for --clips")
    add("--film-3d", action="store_true", help="run the most telling pair again, to be seen in three dimensions")
    _add_outputs(parser.add_argument_group("report"))


_EPISODE = "episode"


def _frames(text: str) -> int | str:
    return text if text == _EPISODE else count(text)


def _run_bench(options: argparse.Namespace) -> int:
    from coopsim.bench.grid.grid_file import find_grid

    given = {"more_policies": options.policy, "trust": options.trust, **flag_values(options)}
    source = find_grid(options.preset, options.grid, **given)
    try:
        return _bench(options, source.grid())
    except CoopsimError as error:
        raise source.blame(error) from error


def _bench(options: argparse.Namespace, grid: Grid) -> int:
    from coopsim.bench.benchmark import benchmark
    from coopsim.bench.dry_run import estimate_benchmark
    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.isolated.isolation import Isolation

    engine = Engine(options.engine, options.workers, options.address)
    isolation = Isolation.of(options.isolate, options.salt_fd)
    if options.json is not None:
        require_writable(options.json)
    if options.dry_run:
        print(estimate_benchmark(grid, options.out, isolation).text("runs", engine.at_once))
        return 0
    with JobsBar("bench", "runs", list(grid.conditions()), engine.at_once) as bar:
        try:
            _require_metrics(grid, options.metrics, import_policies=options.isolate is None)
            results = benchmark(
                grid,
                options.out,
                engine=engine,
                retry_failed=options.retry_failed,
                films=options.clips > 0,
                retry_unfilmed=options.retry_unfilmed,
                space=options.film_3d,
                command=without_flags(options.typed, _NO_NUMBER),
                isolation=isolation,
                on_progress=bar.show,
                on_broken=lambda error: bar.write(f"{error}; its cell is run again"),
            )
        except KeyboardInterrupt:
            stored = f"{bar.finished} of {len(grid)} runs are stored in {options.out}"
            bar.write(f"interrupted; {stored}, and the same command goes on from there")
            return INTERRUPTED
    write_files(options.out, results, options)
    failed = sum(result.failed for result in results) - bar.lost
    bar.tell_of_lost()
    if failed:
        print(f"coopsim: {failed} of {len(grid)} runs failed; --retry-failed repeats them", file=sys.stderr)
    return FAILED if failed or bar.lost else 0


def _require_metrics(grid: Grid, metrics: Sequence[str], *, import_policies: bool) -> None:
    """Refuse a metric that nobody has registered, now and not after the last cell."""
    from coopsim.catalog import PolicySpec
    from coopsim.metrics.built_in import all_metrics

    for text in grid.policies if metrics and import_policies else ():
        PolicySpec.parse(text).policy_class()  # a policy's file may register one
    for name in metrics:
        require_choice("metric", name, all_metrics())


def flag_values(options: argparse.Namespace) -> dict[str, Any]:
    """Return the attributes of a grid that were given as flags."""
    from coopsim.bench.grid.grid import ATTRIBUTES

    given = {name: getattr(options, name, None) for name in ATTRIBUTES}
    given["attacks"] = options.attack or None
    given |= varied(options.vary)
    if options.option or options.detector is not None:
        given["options"] = {**named_options(options), **detector_option(options)}
    return {name: None if value == _EPISODE else value for name, value in given.items() if value is not None}


BENCH = Command(
    "run policies in simulated traffic under latency, loss, noise and narrow channels, with statistics",
    _add_bench,
    _run_bench,
    (
        "coopsim bench --preset quick",
        "coopsim bench --policies no_fusion,late_fusion --environments crossing,town --latencies-ms 0,300 --seeds 0-4",
        "coopsim bench --preset paper --out paper --dry-run",
    ),
)


_NAMES = "policies need --results"


def _add_compare(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("a", metavar="A", help="folder of results, or with --results the name of a policy")
    add("b", metavar="B", help="the same; differences are B - A")
    add("--results", type=Path, metavar="FOLDER", help="where the results of both policies are")
    add("--metrics", type=names, metavar="A,B", help="default: sAMOTA,HOTA; each further one makes all harder to show")
    add_flags(parser, "--json", help="write everything here as well")
    add("--csv", type=Path, metavar="PATH", help="write the rows here as well")


def _run_compare(options: argparse.Namespace) -> int:
    from coopsim.bench.results.comparison import compare_results
    from coopsim.bench.text.comparison_text import to_csv, to_dict, to_text

    paths = [path for path in (options.json, options.csv) if path is not None]
    if len({path.resolve() for path in paths}) < len(paths):
        raise InvalidValueError(f"--json and --csv must be two files, got {options.json} for both")
    for path in paths:
        require_writable(path)
    comparison = compare_results(*_sides(options), options.metrics)
    print(f"A: {options.a}\nB: {options.b}\n\n{to_text(comparison)}")
    if options.json is not None:
        write_whole(options.json, as_json({"a": options.a, "b": options.b, **to_dict(comparison)}))
    if options.csv is not None:
        write_whole(options.csv, to_csv(comparison))
    return 0


def _sides(options: argparse.Namespace) -> tuple[list[CellResult], list[CellResult]]:
    from coopsim.bench.results.comparison import as_one_policy

    if options.results is None:
        return stored_results(Path(options.a), _NAMES), stored_results(Path(options.b), _NAMES)
    if options.a == options.b:
        raise InvalidValueError(f"A and B must be two policies, got {options.a!r} for both")
    results, name = stored_results(options.results), f"{options.b} - {options.a}"
    spelled = {_unspaced(result.cell.policy): result.cell.policy for result in results}
    a, b = (spelled.get(_unspaced(policy), policy) for policy in (options.a, options.b))
    return as_one_policy(results, a, name), as_one_policy(results, b, name)


def _unspaced(policy: str) -> str:
    """Remove spaces from a policy's text, so that users need not spell it as grids do."""
    return "".join(policy.split())


COMPARE = Command(
    "test which differences between two benchmarks, or two policies of one, are significant",
    _add_compare,
    _run_compare,
    ("coopsim compare before after", "coopsim compare no_fusion late_fusion --results coopsim-bench"),
)
