"""`coopsim entry`: entries of the leaderboard, from an empty folder to the page."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.arguments import FAILED, Command, Parser, add_isolate, count

if TYPE_CHECKING:
    from coopsim.bench.benchmark import Progress


def _add_entry(parser: argparse.ArgumentParser) -> None:
    does = parser.add_subparsers(required=True, metavar="COMMAND", dest="does", parser_class=Parser)
    new = does.add_parser("new", help="make a folder with a policy and a card to fill in")
    warm_up = does.add_parser("warm-up", help="run the warm-up, and write warm_up.json")
    score = does.add_parser(
        "score", help="run what ranks, and write scores.json; after Ctrl-C the same command goes on"
    )
    check = does.add_parser("check", help="check folders: card, code, conformance, and the warm-up run again")
    page = does.add_parser("page", help="write the leaderboard of folders as HTML; those with a fault do not enter")
    for one in (new, warm_up, score):
        one.add_argument("folder", type=Path, metavar="FOLDER", help="of the entry")
    for several in (check, page):
        several.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="of an entry")
    for runs in (warm_up, score, check, page):
        add_isolate(runs)
    for long in (score, check, page):
        long.add_argument("--workers", type=count, help="runs at once (default: as many as cores)")
    check.add_argument("--whole", action="store_true", help="run all scores again, too: minutes instead of seconds")
    page.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="gets index.html")
    page.add_argument(
        "--baseline", default="late_fusion", metavar="NAME", help="compare with it (default: %(default)s)"
    )
    page.add_argument("--rerun", action="store_true", help="check as `check` does; else nothing of an entry is run")


def _run_entry(options: argparse.Namespace) -> int:
    return _COMMANDS[options.does](options)


def _new(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.entry_template import write_template

    for path in write_template(options.folder):
        print(f"written: {path}")
    return 0


def _warm_up(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.fixed_run import WARM_UP

    with tempfile.TemporaryDirectory() as store:
        return _measure(options, WARM_UP, Path(store), 1)


def _score(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.entry_folder import RUNS
    from coopsim.bench.entries.fixed_run import SCORED

    return _measure(options, SCORED, options.folder / RUNS, options.workers)


def _measure(options: argparse.Namespace, run: Any, store: Path, workers: int | None) -> int:
    """Run an entry's policy, and write its scores."""
    from tqdm import tqdm

    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.entries.entry_folder import EntryFolder
    from coopsim.bench.entries.fixed_run import mean_of
    from coopsim.bench.isolated.isolation import Isolation

    entry = EntryFolder.read(options.folder)
    with tqdm(total=len(run.cells(entry.name)), unit="run", disable=None, desc=entry.name) as bar:

        def show(progress: Progress) -> None:
            bar.n = progress.stored + progress.done
            bar.refresh()

        scores = run.measure(entry, store, Engine(workers=workers), Isolation(options.isolate), show)
    print(f"{entry.name}: {mean_of(scores)}")
    print(f"written: {run.write(entry.folder, scores)}")
    return 0


def _check(options: argparse.Namespace) -> int:
    problems = _problems(options, rerun=True, whole=options.whole)
    for folder, lines in problems.items():
        for line in lines:
            print(f"{folder}: {line}")
        if not lines:
            print(f"{folder} is as it should be")
    return FAILED if any(problems.values()) else 0


def _page(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.entry_page import Board, enter_all, write_board

    rows, lines = enter_all(options.folders, _problems(options, rerun=options.rerun))
    for line in lines:
        print(line)
    if lines and not rows:
        return FAILED
    board = Board(rows, options.baseline)
    print(f"{board.text()}\n\nwritten: {write_board(board, options.out)}")
    return FAILED if lines else 0


def _problems(options: argparse.Namespace, *, rerun: bool, whole: bool = False) -> dict[Path, list[str]]:
    """Check each folder; without `rerun` nothing of it is run."""
    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.entries.entry_checks import check_entry, check_folder
    from coopsim.bench.isolated.isolation import Isolation

    if not rerun:
        return {folder: check_folder(folder) for folder in options.folders}
    engine, isolation = Engine(workers=options.workers), Isolation(options.isolate)
    return {folder: check_entry(folder, whole=whole, isolation=isolation, engine=engine) for folder in options.folders}


_COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "new": _new,
    "warm-up": _warm_up,
    "score": _score,
    "check": _check,
    "page": _page,
}


ENTRY = Command(
    "enter the leaderboard: make, measure and check a folder, and write the page of several",
    _add_entry,
    _run_entry,
    ("coopsim entry new mine", "coopsim entry check mine", "coopsim entry page mine other --out site"),
)
