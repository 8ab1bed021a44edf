"""The check of an entry: a line for each thing that is wrong."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from coopsim.bench.engine.engine import DoneT, Engine, Work, run_work
from coopsim.bench.entries.entry_files import work_folder
from coopsim.bench.entries.entry_folder import CARD, HEADINGS, OURS, EntryFolder
from coopsim.bench.entries.fixed_run import SCORED, WARM_UP, FixedRun, differences, needs_of
from coopsim.bench.isolated.isolation import Isolation
from coopsim.errors import CoopsimError, LeaderboardEntryError
from coopsim.interfaces.conformance import CONFORMANCE
from coopsim.support.printable import printable
from coopsim.support.rng import fresh_seed, stream

DRAWN = 2
"""Cells of the scores that a check runs again; it draws them itself."""


def check_folder(folder: Path) -> list[str]:
    """Check what an entry's folder has, without running any of it: description, card, code and scores.

    Raises:
        InvalidValueError: there is no such folder.
    """
    try:
        entry = EntryFolder.read(folder)
    except LeaderboardEntryError as error:
        return [_line(error)]
    return [*_card(entry), *_scores(entry)]


def check_entry(folder: Path, *, whole: bool = False, isolation: Isolation, engine: Engine | None = None) -> list[str]:
    """Check an entry's folder; then run it again, each agent in a process of its own, and check its policy.

    The warm-up and some cells of the scores, drawn now, must come out as the files say.

    Args:
        folder: the entry's.
        whole: run all scores again, not some cells.
        isolation: separation of the policy from the world, in processes of its own.
        engine: runs the cells; None: this process, which for a few is quicker than to start others.

    Raises:
        InvalidValueError: there is no such folder.
    """
    problems = check_folder(folder)
    try:
        entry = EntryFolder.read(folder)
        entry.packages()
        with work_folder() as place:
            needs_of(entry.copy_to(place / "entry"), isolation)
    except CoopsimError as error:
        return list(dict.fromkeys([*problems, _line(error)]))
    for run in (WARM_UP, SCORED):
        problems += _rerun(run, entry, None if whole else DRAWN, engine or _Here(), isolation)
    return [*problems, *_conformance(entry, isolation)]


class _Here(Engine):
    """Runs cells in this process, one after another; their policies have processes of their own."""

    def run(self, jobs: Iterator[Work[DoneT]]) -> Generator[DoneT]:
        return (run_work(job) for job in jobs)


def _card(entry: EntryFolder) -> Iterator[str]:
    try:
        card = entry.card()
    except LeaderboardEntryError as error:
        yield _line(error)
        return
    for heading in HEADINGS:
        if heading not in card:
            yield f"{CARD} has no heading {heading!r}"
        elif not card[heading]:
            yield f"{CARD} has nothing under {heading!r}"


def _scores(entry: EntryFolder) -> Iterator[str]:
    try:
        code = {**entry.code(), **_others(entry.packages())}
    except CoopsimError as error:
        yield _line(error)
        return
    for run in (WARM_UP, SCORED):
        try:
            yield from _stale(run, entry, run.read(entry), code)
        except LeaderboardEntryError as error:
            yield _line(error)


def _stale(run: FixedRun, entry: EntryFolder, scores: Mapping[str, Any], code: Mapping[str, str]) -> Iterator[str]:
    """Yield how the scores of a file are not those of the entry as it is."""
    remedy = f"run `coopsim entry {run.command} {entry.folder}`"
    if scores["policy"] != entry.policy:
        yield f"{run.file} is of the policy {scores['policy']!r}, and the entry's is {entry.policy!r}: {remedy}"
    cells = run.cells(entry.name)
    if scores["run"] != f"{run.preset} {run.digest}" or _names(scores) != list(cells):
        yield f"{run.file} is of another fixed run than that of this coopsim: {remedy}"
    elif [cell["place_seed"] for cell in scores["cells"]] != [cell.seed for cell in cells.values()]:
        yield f"{run.file} is of other towns than those of its cells: {remedy}"
    before = {**scores["code"], **_others(scores["packages"])}
    changed = sorted(name for name in before.keys() | code.keys() if before.get(name) != code.get(name))
    if changed:
        yield f"{', '.join(changed)} changed since {run.file} was made: {remedy}"


def _others(packages: Mapping[str, str]) -> dict[str, str]:
    """Return the packages but ours, by names that no file has."""
    return {f"package {name}:": digest for name, digest in packages.items() if name != OURS}


def _names(scores: Mapping[str, Any]) -> list[str]:
    return [cell["cell"] for cell in scores["cells"]]


def _conformance(entry: EntryFolder, isolation: Isolation) -> Iterator[str]:
    try:
        with work_folder() as place, ExitStack() as stack:
            spec = entry.copy_to(place / "entry").spec()
            CONFORMANCE.get("policy")(lambda: stack.enter_context(isolation.policy(spec)))
    except (AssertionError, CoopsimError) as error:
        yield _line(error).replace("<lambda>", entry.policy)


def _rerun(run: FixedRun, entry: EntryFolder, drawn: int | None, engine: Engine, isolation: Isolation) -> Iterator[str]:
    """Run cells again, and yield what came out otherwise than the file says."""
    try:
        stored = run.read(entry)
    except LeaderboardEntryError:
        stored = None  # the folder's check says so
    try:
        fresh, _ = run.measure(entry, engine, isolation, only=_draw(list(run.cells(entry.name)), drawn))
    except CoopsimError as error:
        yield _line(error)
        return
    if stored is not None and set(_names(fresh)) <= set(_names(stored)):
        yield from differences(run.file, stored, fresh)


def _draw(names: Sequence[str], count: int | None) -> list[str]:
    """Draw some names by chance that nobody knows before; None: all."""
    if count is None or count >= len(names):
        return list(names)
    chosen = stream(fresh_seed(), "cells to repeat").choice(len(names), count, replace=False)
    return [names[k] for k in sorted(chosen.tolist())]


def _line(error: Exception) -> str:
    return printable(" ".join(str(error).split()))
