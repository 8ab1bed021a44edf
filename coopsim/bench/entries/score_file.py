"""Files of scores: written with a line for each cell, and read with a check of every key, as others write them too."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any

from coopsim.bench.entries.entry_files import read_text
from coopsim.errors import LeaderboardEntryError
from coopsim.metrics.built_in import BUILT_IN
from coopsim.support.files import write_whole

SAME = ("software", "processor", "arithmetic")
"""Keys of what decides the last bits of scores."""

_BELOW_ZERO = {"AMOTA", "MOTA", "sMOTA", "MODA", "AMOTA@2m"}
_MOST = 1e9
_PER_CENT = 100 + 1e-9  # a sum of shares may end above 1


def write_scores(path: Path, scores: Mapping[str, Any]) -> Path:
    """Write scores, a line for each cell."""
    lines = ",\n    ".join(json.dumps(cell, ensure_ascii=False) for cell in scores["cells"])
    text = json.dumps({**scores, "cells": []}, indent=2)
    return write_whole(path, text.replace('"cells": []', f'"cells": [\n    {lines}\n  ]') + "\n")


def read_scores(path: Path, metrics: Collection[str], more: Mapping[str, Callable[[Any], bool]]) -> dict[str, Any]:
    """Read scores.

    Args:
        path: the file.
        metrics: names of the values of each cell: no others, and all of them where they are not `BUILT_IN`.
        more: further keys, and the checks of their values.

    Raises:
        LeaderboardEntryError: the file cannot be read, or a value is missing, of another type or out of range; says
            which.
    """
    try:
        scores = json.loads(read_text(path), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        reason = str(error) if isinstance(error, ValueError) else "too many brackets"
        raise LeaderboardEntryError(f"{path.name} is broken: it is no JSON of numbers ({reason})") from error
    checks = {**_CHECKS, **more, "cells": _is_full_list}
    if not isinstance(scores, dict) or scores.keys() != checks.keys():
        raise LeaderboardEntryError(f"{path.name} is broken: it must have the keys {', '.join(checks)} and no others")
    for key, accepts in checks.items():
        if not accepts(scores[key]):
            raise LeaderboardEntryError(f"{path.name} is broken: {key} cannot be {short(scores[key])}")
    for number, cell in enumerate(scores["cells"]):
        wrong = _wrong_in(cell, metrics)
        if wrong:
            raise LeaderboardEntryError(f"{path.name} is broken: cell {number} {wrong}")
    return scores


def is_text(value: Any) -> bool:
    """Return whether a value is a text of one line."""
    return isinstance(value, str) and len(value) <= 1000 and value.isprintable()


def is_digest(value: Any) -> bool:
    """Return whether a value is a SHA-256 in hexadecimal digits."""
    return isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None


def _is_full_list(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0


def _is_table_of(accepts: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(is_text(key) and accepts(each) for key, each in value.items())


_CHECKS: dict[str, Callable[[Any], bool]] = {
    "policy": is_text,
    "reads": lambda value: isinstance(value, str) and value in ("boxes", "sensors"),
    "run": is_text,
    "software": _is_table_of(is_text),
    "processor": is_text,
    "arithmetic": is_text,
    "code": _is_table_of(is_digest),
    "packages": _is_table_of(is_digest),
}


def _wrong_in(cell: Any, metrics: Collection[str]) -> str:
    """Return what is wrong with a cell; empty if nothing is."""
    if not isinstance(cell, dict) or cell.keys() != {"cell", "place_seed", "values"}:
        return "must have the keys cell, place_seed and values"
    if not is_text(cell["cell"]):
        return "must have a name"
    seed, values = cell["place_seed"], cell["values"]
    if type(seed) is not int or not 0 <= seed < 2**63:
        return f"must have a place_seed of 0 or more, got {short(seed)}"
    if not isinstance(values, dict) or not values.keys() <= set(metrics):
        return "must have values of the metrics of this run"
    if metrics is not BUILT_IN and len(values) < len(metrics):
        return f"must have values of {', '.join(metrics)}"
    for name, value in values.items():
        least, most = _range_of(name)
        if value is not None and not (type(value) in (int, float) and least <= value <= most):
            return f"cannot have {name} {short(value)}: it is {least:g} to {most:g}"
    return ""


def _range_of(name: str) -> tuple[float, float]:
    least = -_MOST if name in _BELOW_ZERO else 0.0
    return least, _PER_CENT if getattr(BUILT_IN[name], "unit", "%") == "%" else _MOST


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is no number")


def floats(values: Mapping[str, float | None]) -> dict[str, float]:
    """Return values of a file as results have them: what is undefined is NaN."""
    return {name: math.nan if value is None else float(value) for name, value in values.items()}
