"""`coopsim entry`: entries of the leaderboard, from an empty folder to the page."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from coopsim.cli.argument_types import seconds
from coopsim.cli.arguments import FAILED, Command, Parser, add_flags
from coopsim.cli.jobs_bar import JobsBar
from coopsim.errors import InvalidValueError


def _add_entry(parser: argparse.ArgumentParser) -> None:
    does = parser.add_subparsers(required=True, metavar="COMMAND", dest="does", parser_class=Parser)
    new = does.add_parser("new", help="make a folder with a policy and a card to fill in")
    warm_up = does.add_parser("warm-up", help="run the warm-up, and write warm_up.json")
    of = "run the public towns, and write scores.json, or those that rank, with a salt; after Ctrl-C it goes on"
    score = does.add_parser("score", help=of)
    check = does.add_parser("check", help="check folders: card, code, conformance, and some runs again, isolated")
    page = does.add_parser("page", help="write the leaderboard of folders as HTML; those with a fault do not enter")
    for one in (new, warm_up, score):
        one.add_argument("folder", type=Path, metavar="FOLDER", help="of the entry")
    for several in (check, page):
        several.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="of an entry")
    of = "time limit of a frame; each agent runs in a process of its own, always (default: %(default)g)"
    for runs in (warm_up, score, check, page):
        runs.add_argument("--isolate", type=seconds, default=60.0, metavar="SECONDS", help=of)
    for secret in (score, page):
        add_flags(secret, "--salt-fd")
    score.add_argument("--out", type=Path, metavar="FOLDER", help="of the organisers' runs, which get one more")
    page.add_argument("--runs", type=Path, metavar="FOLDER", help="the organisers' runs; without, nothing is ranked")
    for long in (score, check, page):
        add_flags(long, "--workers", help="runs at once (default: as many as cores; few runs: one, here)")
    check.add_argument("--whole", action="store_true", help="run all scores again: minutes instead of seconds")
    page.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="gets index.html")
    of = "compare with it (default: %(default)s)"
    page.add_argument("--baseline", default="late_fusion", metavar="NAME", help=of)
    page.add_argument("--rerun", action="store_true", help="check as `check` does; else nothing of an entry is run")


def _run_entry(options: argparse.Namespace) -> int:
    return _COMMANDS[options.does](options)


def _new(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.entry_template import write_template

    for path in write_template(options.folder):
        print(f"written: {path}")
    return 0


def _warm_up(options: argparse.Namespace) -> int:
    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.entries.entry_folder import EntryFolder
    from coopsim.bench.entries.fixed_run import WARM_UP
    from coopsim.bench.isolated.isolation import Isolation

    entry = EntryFolder.read(options.folder)
    with JobsBar(entry.name, "runs") as bar:
        scores, _ = WARM_UP.measure(entry, Engine(workers=1), Isolation(options.isolate), on_progress=bar.show)
    return _told(entry.name, scores, WARM_UP.write(entry.folder, scores))


def _score(options: argparse.Namespace) -> int:
    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.entries.entry_folder import EntryFolder
    from coopsim.bench.entries.fixed_run import SCORED
    from coopsim.bench.entries.ranking import run_ranking
    from coopsim.bench.isolated.isolation import Isolation

    if (options.out is None) != (options.salt_fd is None):
        raise InvalidValueError("out and salt-fd must be given both, for a ranking run, or neither, for scores.json")
    entry, engine = EntryFolder.read(options.folder), Engine(workers=options.workers)
    isolation, key = Isolation.of(options.isolate, options.salt_fd), f"{entry.digest[:24]}-{SCORED.digest}"
    with JobsBar(entry.name, "runs", workers=engine.at_once) as bar:
        if options.out is not None:
            return _told(entry.name, *run_ranking(entry, options.out, engine, isolation, bar.show))
        scores, _ = SCORED.measure(entry, engine, isolation, work=key, on_progress=bar.show)
    return _told(entry.name, scores, SCORED.write(entry.folder, scores))


def _told(name: str, scores: Mapping[str, Any], written: Path) -> int:
    from coopsim.bench.entries.fixed_run import mean_of

    print(f"{name}: {mean_of(scores)}\nwritten: {written}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from coopsim.support.printable import printable

    problems = _problems(options, rerun=True, whole=options.whole)
    for folder, lines in problems.items():
        for line in lines:
            print(printable(f"{folder}: {line}"))
        if not lines:
            print(printable(f"{folder} is as it should be"))
    return FAILED if any(problems.values()) else 0


def _page(options: argparse.Namespace) -> int:
    from coopsim.bench.entries.entry_page import Board, enter_all, write_board
    from coopsim.bench.entries.ranking import read_rankings
    from coopsim.bench.isolated.isolation import Isolation
    from coopsim.support.printable import printable

    rankings, left_out = read_rankings(options.runs, Isolation.of(options.isolate, options.salt_fd))
    rows, lines = enter_all(options.folders, _problems(options, rerun=options.rerun), rankings)
    for line in (*left_out, *lines):
        print(printable(line))
    if lines and not rows:
        return FAILED
    board = Board(rows, options.baseline)
    print(f"{board.text()}\n\nwritten: {write_board(board, options.out)}")
    return FAILED if lines or left_out else 0


def _problems(options: argparse.Namespace, *, rerun: bool, whole: bool = False) -> dict[Path, list[str]]:
    """Check each folder; without `rerun` nothing of it is run."""
    from coopsim.bench.engine.engine import Engine
    from coopsim.bench.entries.entry_checks import check_entry, check_folder
    from coopsim.bench.isolated.isolation import Isolation

    if not rerun:
        return {folder: check_folder(folder) for folder in options.folders}
    isolation = Isolation(options.isolate)
    engine = Engine(workers=options.workers) if whole or options.workers is not None else None
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
