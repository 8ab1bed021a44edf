"""The check of an entry: a line for each thing that is wrong."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries.entry_folder import CARD, HEADINGS, OURS, EntryFolder
from coopsim.bench.entries.fixed_run import SCORED, WARM_UP, FixedRun, differences, needs_of
from coopsim.bench.isolated.isolation import Isolation
from coopsim.errors import CoopsimError, LeaderboardEntryError


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


def check_entry(
    folder: Path,
    *,
    whole: bool = False,
    isolation: Isolation = Isolation(),  # noqa: B008  (frozen)
    engine: Engine | None = None,
) -> list[str]:
    """Check an entry's folder; then check its policy, and run the warm-up again, which must come out equal.

    Args:
        folder: the entry's.
        whole: run all scores again, not the warm-up alone.
        isolation: separation of the policy from the world.
        engine: runs the cells; None: processes of this machine, as many as cores.

    Raises:
        InvalidValueError: there is no such folder.
    """
    problems = check_folder(folder)
    try:
        entry = EntryFolder.read(folder)
        entry.code()
        needs_of(entry, isolation)
    except CoopsimError as error:
        return list(dict.fromkeys([*problems, _line(error)]))
    problems += _conformance(entry, isolation)
    for run in (WARM_UP, SCORED) if whole else (WARM_UP,):
        problems += _rerun(run, entry, engine or Engine(), isolation)
    return problems


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
        code = entry.code()
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
    if scores["run"] != f"{run.preset} {run.digest}" or _names(scores) != list(run.cells(entry.name)):
        yield f"{run.file} is of another fixed run than that of this coopsim: {remedy}"
    before = scores["code"]
    changed = sorted(name for name in before.keys() | code.keys() if before.get(name) != code.get(name))
    changed = [name for name in changed if name != OURS]
    if changed:
        yield f"{', '.join(changed)} changed since {run.file} was made: {remedy}"


def _names(scores: Mapping[str, Any]) -> list[str]:
    return [cell["cell"] for cell in scores["cells"]]


def _conformance(entry: EntryFolder, isolation: Isolation) -> Iterator[str]:
    from coopsim.testing import check_policy  # which plays episodes, and so stands on this room

    spec = entry.spec()
    try:
        with ExitStack() as stack:
            check_policy(lambda: stack.enter_context(isolation.policy(spec)))
    except (AssertionError, CoopsimError) as error:
        yield _line(error).replace("<lambda>", entry.policy)


def _rerun(run: FixedRun, entry: EntryFolder, engine: Engine, isolation: Isolation) -> Iterator[str]:
    """Run again, and yield what came out otherwise."""
    try:
        with tempfile.TemporaryDirectory() as store:
            fresh = run.measure(entry, Path(store), engine, isolation)
    except CoopsimError as error:
        yield _line(error)
        return
    try:
        stored = run.read(entry)
    except LeaderboardEntryError:
        return  # the folder's check says so
    if _names(stored) == _names(fresh):
        yield from differences(run.file, stored, fresh)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
