"""Columns that grow in bounded memory."""

from __future__ import annotations

import copy
import pickle
import tempfile
from typing import Any

import numpy as np
import pytest

from coopsim.metrics.growing_columns import GrowingColumns

CODES = {"id": "q", "label": "b", "score": "d"}


def grown(most_bytes: int, rows: int = 400) -> tuple[GrowingColumns, dict[str, list[Any]]]:
    """Return columns that grew by 0 to 4 values of each column at a time, and what they were given."""
    rng = np.random.default_rng(0)
    columns, given = GrowingColumns(CODES, most_bytes), {name: [] for name in CODES}  # type: ignore[var-annotated]
    for _ in range(rows):
        added = {name: (100 * rng.random(rng.integers(5))).astype(code) for name, code in CODES.items()}
        columns.append(added)
        for name, values in added.items():
            given[name].extend(values.tolist())
    return columns, given


@pytest.mark.parametrize("most_bytes", [0, 100, 1000, 10**9])
def test_every_value_comes_back_in_order(most_bytes: int) -> None:
    columns, given = grown(most_bytes)
    for name, code in CODES.items():
        column = columns.column(name)
        assert column.dtype == np.dtype(code)
        assert column.tolist() == given[name]
        column[:] = 0  # a copy
        assert columns.column(name).tolist() == given[name]


def test_memory_is_bounded() -> None:
    columns, _ = grown(1000)
    held = sum(len(column) * column.itemsize for column in columns._recent.values())
    assert held <= 1000 + 64 * sum(4 * np.dtype(code).itemsize for code in CODES.values())
    assert columns._file is not None


@pytest.mark.parametrize("again", [copy.deepcopy, lambda columns: pickle.loads(pickle.dumps(columns))])
def test_a_copy_has_everything_and_grows_by_itself(again: Any) -> None:
    columns, given = grown(100)
    other = again(columns)
    other.append({"id": [7]})
    assert other.column("id").tolist() == [*given["id"], 7]
    assert columns.column("id").tolist() == given["id"]


def test_without_room_for_a_file_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: Any) -> Any:
        raise OSError("No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    with pytest.warns(UserWarning, match="stays in memory"):
        columns, given = grown(100)
    assert columns.column("score").tolist() == given["score"]


def test_a_write_that_fails_half_way_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    columns, given = grown(100, rows=50)
    written = []

    def failing(file: Any, values: bytes) -> None:
        if written:
            raise OSError("No space left on device")
        written.append(file.write(values))

    monkeypatch.setattr(columns, "_write", failing)
    columns.append({"score": np.arange(100.0)})
    with pytest.warns(UserWarning, match="No space left"):
        columns.column("id")
    assert columns.column("id").tolist() == given["id"]
    assert columns.column("score").tolist() == [*given["score"], *range(100)]
