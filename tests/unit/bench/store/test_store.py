"""Results on disk: nothing is lost on the way, the same result is the same bytes, and what is broken is noticed."""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.store.cell_file import _checksum, _row, decode, encode
from coopsim.bench.store.fingerprint import fingerprint, key_of
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError, StoreError

CELL = Cell(
    "late_fusion(delayed=replay)",
    Condition("crossing", latency_s=0.1, loss=0.2, position_noise_m=0.3, heading_noise_deg=0.4, bandwidth_bit_s=1e6),
    7,
    5,
)
RESULT = CellResult(
    CELL,
    {"MOTA": 61.25, "MOTP": math.nan},
    {"cav_0": {"MOTA": 1 / 3}, "rsu_0": {"MOTA": -math.inf}},
    np.array([0.1, -0.2, 0.3, 1e-300, 0.0]),
    {"sent": 12, "lost": 3},
    counts={"pairs by geometry alone": 5},
    method="half of a paper",
)
FAILED = CellResult(replace(CELL, seed=8), traceback="Traceback ...\nValueError: ü\n")


def same(a: CellResult, b: CellResult) -> bool:
    return repr((a.cell, a.values, a.agents, a.rewards.tolist(), a.messages, a.traceback, a.counts, a.method)) == repr(
        (b.cell, b.values, b.agents, b.rewards.tolist(), b.messages, b.traceback, b.counts, b.method)
    )


CONNECTED = CellResult(Cell("a", Condition(penetration=0.25), frames=None))
VARIED = CellResult(Cell("a", Condition(settings={"weather.rain_mm_h": 1 / 3, "lidar": None, "rig": ["front"]})))


@pytest.mark.parametrize("result", [RESULT, FAILED, CONNECTED, VARIED, CellResult(Cell("a", Condition()))])
def test_nothing_is_lost_and_the_bytes_are_the_same(result: CellResult) -> None:
    content = encode(result, "why")
    back, decided_by = decode(content)
    assert decided_by == "why" and same(back, result)
    assert encode(back, decided_by) == content


OLD = ("scenario", "latency_s", "loss", "position_noise_m", "heading_noise_deg", "bandwidth_bit_s")
"""The columns of a condition before it could have any option; two more were there where they were set."""


@pytest.mark.parametrize(("result", "more"), [(RESULT, ()), (CONNECTED, ("penetration",))])
def test_a_file_of_the_older_layout_is_read(result: CellResult, more: tuple[str, ...]) -> None:
    table = pq.read_table(pa.BufferReader(encode(result, "why")))
    gone = {"settings", "penetration", "attacks"} - {*more}
    row = {name: value for name, value in _row(encode(result, "why")).items() if name not in {"checksum", *gone}}
    assert {*OLD, *more} <= row.keys() and "settings" not in row
    kept = pa.schema([column for column in table.schema if column.name not in gone])
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist([{**row, "checksum": _checksum(row)}], kept), sink)
    back, decided_by = decode(bytes(sink.getvalue()))
    assert decided_by == "why" and same(back, result)


@given(st.data())
def test_a_broken_file_is_noticed_or_says_the_same(data: st.DataObject) -> None:
    """Whatever bytes are changed or cut off."""
    content = bytearray(encode(RESULT, "why"))
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
            content[place] ^= data.draw(st.integers(1, 255))
    try:
        result, decided_by = decode(bytes(content))
    except StoreError:
        return
    assert same(result, RESULT) and decided_by == "why"


def test_what_is_put_is_there(tmp_path: Path) -> None:
    store = Store(tmp_path / "new" / "folder")
    keys = [key_of("b"), key_of("a")]
    assert store.get(keys[0]) is None and store.results() == []
    store.put(RESULT, "b", {"seconds": 1.5})
    store.put(FAILED, "a")
    found = store.get(keys[0])
    assert found is not None and same(found, RESULT)
    assert store.circumstances(keys[0]) == {"seconds": 1.5} and store.circumstances("nothing") == {}
    assert {result.cell.seed for result in store.results()} == {7, 8}
    store.begin([keys[0], key_of("not yet run")])
    assert store.all_circumstances() == [{"seconds": 1.5}, {}]
    assert [result.cell.seed for result in store.results()] == [7]
    store.put(replace(RESULT, values={"MOTA": 9.0}), "a newer version")
    found_again = {result.cell.seed: result for result in store.results(all_grids=True)}
    assert set(found_again) == {7, 8} and found_again[7].values == {"MOTA": 9.0}, "the newest of a cell"


def test_a_file_of_another_key_is_broken(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put(RESULT, "a")
    store.path_of(key_of("a")).rename(store.path_of(key_of("b")))
    with pytest.raises(StoreError, match=f"{key_of('b')}.parquet is broken: its content has another key"):
        store.get(key_of("b"))
    store.path_of(key_of("b")).write_bytes(b"PAR1")
    with pytest.raises(StoreError, match=r"\.parquet is broken: "):
        store.results()


def test_what_a_killed_command_left_is_removed_later(tmp_path: Path) -> None:
    store = Store(tmp_path)
    old, new = (store.path_of("x").with_name(name) for name in ("old.tmp", "new.tmp"))
    old.write_text("half")
    new.write_text("half")
    os.utime(old, (time.time() - 7200,) * 2)
    Store(tmp_path)
    assert not old.exists() and new.exists()


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidValueError, match="cannot make the folder"):
        Store(tmp_path / "file")


def test_all_that_decides_a_result_is_in_its_key(tmp_path: Path) -> None:
    mine, lidar = tmp_path / "mine.py", tmp_path / "lidar.csv"
    policy = "import coopsim\nclass P(coopsim.Policy):\n    def track(self, agent, observation): ...\n"
    mine.write_text(policy)
    lidar.write_text("1\n")

    def key(cell: Cell = CELL, options: dict[str, object] | None = None, policy: str = "late_fusion") -> str:
        return key_of(fingerprint(cell, options or {}, PolicySpec.parse(policy)))

    keys = [
        key(),
        key(replace(CELL, seed=8)),
        key(replace(CELL, frames=6)),
        key(replace(CELL, condition=CELL.condition.changed(loss=0.0))),
        key(options={"vehicles": 8}),
        key(options={"lidar": str(lidar)}),
        key(policy=f"{mine}:P"),
    ]
    assert len(set(keys)) == len(keys)
    assert key(options={"a": 1, "b": (2,)}) == key(options={"b": [2], "a": 1})
    lidar.write_text("2\n")
    mine.write_text(policy + "# another\n")
    assert key(options={"lidar": str(lidar)}) != keys[5] and key(policy=f"{mine}:P") != keys[6]
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(f"scenario: crossing\noptions: {{lidar: {lidar.name}}}\n")  # beside it
    before = key(replace(CELL, condition=Condition(str(scenario))))
    lidar.write_text("3\n")
    assert key(replace(CELL, condition=Condition(str(scenario)))) != before
    weights = tmp_path / "mine.safetensors"
    weights.write_bytes(b"1")
    learned = {"policy": f"fcooper(weights='{weights}')"}
    nested = {"policy": f'dino_codt_tracking(embedder="picture_identity(weights={weights})")'}
    given = {"options": {"detector": f"pillars(weights={weights})"}}
    befores = [key(**named) for named in (learned, nested, given)]  # type: ignore[arg-type]
    weights.write_bytes(b"2")
    for named, before in zip((learned, nested, given), befores, strict=True):
        assert key(**named) != before  # type: ignore[arg-type]


def test_arrays_stand_beside_a_result(tmp_path: Path) -> None:
    store, decided_by = Store(tmp_path), "why"
    arrays = {"box": np.arange(14.0).reshape(2, 7), "text": np.frombuffer(b"{}", np.uint8)}
    store.put(replace(RESULT, arrays=arrays), decided_by)
    key = key_of(decided_by)
    back, path = store.get(key), store.path_of(key).with_suffix(".npz")
    assert back is not None and same(back, RESULT) and back.arrays.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(back.arrays[name], array)
    content, refused = path.read_bytes(), 0
    for place in range(0, len(content), max(1, len(content) // 100)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            store.get(key)  # some bytes, as a date, mean nothing
        except StoreError as error:
            refused += f"{key}.npz is broken" in str(error)
    assert refused > 60
