"""`coopsim compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.bench.grid.cell import CellResult
from coopsim.cli.arguments import as_json, names, stored_results
from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable, write_whole

HELP = "test which differences between two benchmarks, or two policies of one, are significant"

_NAMES = "policies need --results"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("a", metavar="A", help="folder of results, or with --results the name of a policy")
    add("b", metavar="B", help="the same; differences are B - A")
    add("--results", type=Path, metavar="FOLDER", help="where the results of both policies are")
    add("--metrics", type=names, metavar="A,B", help="default: sAMOTA,HOTA; each further one makes all harder to show")
    add("--json", type=Path, metavar="PATH", help="write everything here as well")
    add("--csv", type=Path, metavar="PATH", help="write the rows here as well")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.bench.report.comparison_text import to_csv, to_dict, to_text
    from coopsim.bench.results.comparison import compare_results

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
