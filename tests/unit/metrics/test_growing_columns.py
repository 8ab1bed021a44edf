"""Columns that grow in bounded memory."""

from __future__ import annotations

import copy
import os
import pickle
import tempfile
from typing import Any

import numpy as np
import pytest

from coopsim.metrics.growing_columns import GrowingColumns, Spool

CODES = {"id": "q", "label": "b", "score": "d"}


def grown(most_bytes: int, rows: int = 400) -> tuple[GrowingColumns, dict[str, list[Any]]]:
    """Return columns that grew by 0 to 4 values of each column at a time, and what they were given."""
    rng = np.random.default_rng(0)
    columns, given = GrowingColumns(CODES, most_bytes=most_bytes), {name: [] for name in CODES}  # type: ignore[var-annotated]
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
    assert columns._spilled["id"]


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
    write = os.pwrite
    written: list[int] = []

    def failing(file: int, values: memoryview, place: int) -> int:
        if written:
            raise OSError("No space left on device")
        written.append(write(file, values[: len(values) // 2], place))
        return written[0]

    monkeypatch.setattr(os, "pwrite", failing)
    columns.append({"score": np.arange(100.0)})
    with pytest.warns(UserWarning, match="No space left"):
        columns.column("id")
    assert columns.column("id").tolist() == given["id"]
    assert columns.column("score").tolist() == [*given["score"], *range(100)]


def test_a_system_that_reads_and_writes_a_few_bytes_at_a_time_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pread, os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda file, values, place: write(file, values[:7], place))
    monkeypatch.setattr(os, "pread", lambda file, count, place: read(file, min(count, 5), place))
    columns, given = grown(100)
    assert columns._spilled["score"]
    for name in CODES:
        assert columns.column(name).tolist() == given[name]


def test_a_file_that_was_cut_short_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    columns, _ = grown(100)
    monkeypatch.setattr(os, "pread", lambda *_: b"")
    with pytest.raises(OSError, match="cut short"):
        columns.column("score")


def test_two_share_a_file() -> None:
    spool, rng = Spool(), np.random.default_rng(0)
    both = [GrowingColumns({"score": "d"}, spool, most_bytes=100) for _ in range(2)]
    given: list[list[float]] = [[], []]
    for _ in range(300):
        for columns, values in zip(both, given, strict=True):
            added = rng.random(3)
            columns.append({"score": added})
            values.extend(added.tolist())
    assert [columns.column("score").tolist() for columns in both] == given


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_fork_does_not_mix_with_its_parent() -> None:
    columns, given = grown(100)
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        columns.append({"id": np.full(1000, -1)})
        os.write(writer, bytes([columns.column("id").tolist() == [*given["id"], *[-1] * 1000]]))
        os._exit(0)
    assert os.read(reader, 1) == b"\x01"
    os.waitpid(child, 0)
    columns.append({"id": np.full(1000, -2)})
    assert columns.column("id").tolist() == [*given["id"], *[-2] * 1000]
    os.close(reader)
    os.close(writer)


def test_a_system_without_positions_in_its_calls_reads_and_writes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Windows."""
    monkeypatch.delattr(os, "pread")
    monkeypatch.delattr(os, "pwrite")
    columns, given = grown(100)
    assert {name: columns.column(name).tolist() for name in CODES} == given
