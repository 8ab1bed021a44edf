"""Ranking runs: scores that the organisers made with a secret salt, in a folder that no entrant writes to."""

from __future__ import annotations

import hmac
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries.entry_folder import OURS, EntryFolder
from coopsim.bench.entries.fixed_run import SCORED
from coopsim.bench.entries.score_file import SAME, is_digest, is_text, read_scores, write_scores
from coopsim.bench.isolated.isolation import Isolation
from coopsim.errors import InvalidValueError, LeaderboardEntryError
from coopsim.support.files import make_folder

_MORE: dict[str, Callable[[Any], bool]] = {
    "entry": is_digest,
    "salt": is_digest,
    "confinement": lambda value: (
        isinstance(value, dict) and all(is_text(key) and isinstance(each, bool) for key, each in value.items())
    ),
    "seal": is_digest,
}
"""Keys besides those of self-reported scores: the entry's digest, that of the salt, which parts of the processes'
confinement held, and what only those can make of all this who have the salt."""


def run_ranking(
    entry: EntryFolder,
    out: Path,
    engine: Engine,
    isolation: Isolation,
    on_progress: Callable[[Any], object] = lambda progress: None,
) -> tuple[dict[str, Any], Path]:
    """Run what ranks with a salt, and write the scores into the organisers' folder. Return both.

    Raises:
        CoopsimError: there is no salt, the folder is the entry's, or as `FixedRun.measure`.
    """
    if isolation.salt is None:
        raise InvalidValueError("a ranking run needs a salt: give --salt-fd")
    if out.resolve().is_relative_to(entry.folder.resolve()):
        raise InvalidValueError(f"out must not be in the entry's folder, got {out}")
    make_folder(out)
    key = f"{entry.digest[:24]}-{isolation.seal(SCORED.digest.encode())[:24]}"
    scores, confinement = SCORED.measure(entry, engine, isolation, work=key, on_progress=on_progress)
    ranking = {**scores, "entry": entry.digest, "salt": isolation.commitment, "confinement": confinement}
    ranking["seal"] = isolation.seal(_content(ranking))
    name = re.sub(r"[^\w.-]", "_", entry.folder.resolve().name)
    return ranking, write_scores(out / f"{name}.json", ranking)


def read_rankings(folder: Path | None, isolation: Isolation) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Read the ranking runs of a folder that can be compared with each other.

    Args:
        folder: the organisers' folder; None: there are no ranking runs.
        isolation: with the salt, whose seals are then checked.

    Returns:
        Scores by the digest of the entry, and a line for each file that is left out.
    """
    found, lines = dict[str, dict[str, Any]](), list[str]()
    for path in sorted(folder.glob("*.json")) if folder is not None else ():
        try:
            found[path.name] = _read(path, isolation)
        except LeaderboardEntryError as error:
            lines.append(f"{path}: {error}")
    kinds = {name: _kind(ranking) for name, ranking in found.items()}
    usual = Counter(kinds.values()).most_common(1)[0][0] if kinds else ""
    apart = [name for name, kind in kinds.items() if kind != usual]
    reason = "is of another salt, machine, run or version than most, and not ranked: run all again"
    lines += [f"{Path(str(folder), name)} {reason}" for name in apart]
    return {ranking["entry"]: ranking for name, ranking in found.items() if name not in apart}, lines


def _read(path: Path, isolation: Isolation) -> dict[str, Any]:
    ranking = read_scores(path, SCORED.kept, _MORE)
    if [cell["cell"] for cell in ranking["cells"]] != list(SCORED.cells("")):
        raise LeaderboardEntryError(f"{path.name} is of another fixed run than that of this coopsim")
    if isolation.salt is not None and not hmac.compare_digest(ranking["seal"], isolation.seal(_content(ranking))):
        raise LeaderboardEntryError(f"{path.name} has not the seal of this salt: others made it")
    return ranking


def _kind(ranking: Mapping[str, Any]) -> str:
    """Return what two rankings must have in common for their scores to be compared."""
    kind = [ranking["run"], ranking["salt"], ranking["packages"][OURS], *(ranking[key] for key in SAME)]
    return json.dumps(kind, sort_keys=True)


def _content(ranking: Mapping[str, Any]) -> bytes:
    return json.dumps({key: value for key, value in ranking.items() if key != "seal"}, sort_keys=True).encode()
