"""The losses of a training, in `log.jsonl`: a line for every step, and one for each look at held-out places."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.errors import InvalidValueError
from coopsim.support.files import write_durably

LOG = "log.jsonl"
"""Name of the file in a training's folder."""


class TrainingLog:
    """Losses of all steps, and values of held-out places.

    Args:
        folder: of the training.
        step: steps taken; later lines, of before an interruption, are left out: they come again.
        writes: whether this process writes files.
    """

    def __init__(self, folder: Path, step: int, *, writes: bool = True) -> None:
        self._path, self._writes = folder / LOG, writes
        self._lines = [line for line in read_log(folder) if line["step"] <= step] if step else []

    def add(self, step: int, values: Mapping[str, float], kind: str = "losses") -> None:
        """Add values after a step, from 1; of the kind "losses" or "validation"."""
        self._lines.append({"step": step, "kind": kind, **{name: round(value, 6) for name, value in values.items()}})

    def write(self) -> None:
        """Write the file; it is as durable as the checkpoint beside it."""
        if self._writes:
            write_durably(self._path, "".join(f"{json.dumps(line)}\n" for line in self._lines).encode())


def read_log(folder: Path) -> list[dict[str, Any]]:
    """Read the log of a training; empty if there is none.

    Raises:
        InvalidValueError: the file is broken; names the line.
    """
    path = folder / LOG
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    found: list[dict[str, Any]] = []
    for number, line in enumerate(lines, 1):
        try:
            found.append({**json.loads(line)})
            found[-1]["step"] = int(found[-1]["step"])
        except (ValueError, TypeError, KeyError) as error:
            raise InvalidValueError("this is no line of a training's log").at(f"{path}:{number}") from error
    return found


def mean_values(lines: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean of each value by name, over those lines that have it: not every step has every loss."""
    found: dict[str, list[float]] = {}
    for line in lines:
        for name, value in line.items():
            if name != "kind":
                found.setdefault(name, []).append(value)
    return {name: sum(values) / len(values) for name, values in found.items()}
