"""Blocks carry any content; large arrays are views, and their memory is used again only when they are gone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from coopsim.envs.vector.shared_blocks import SharedBlocks

Ends = tuple[SharedBlocks, SharedBlocks]


@pytest.fixture
def ends() -> Iterator[Ends]:
    reader = SharedBlocks.new()
    writer = SharedBlocks(os.dup(reader.file))
    yield writer, reader
    writer.close()
    reader.close()


def sent(ends: Ends, content: Any) -> Any:
    writer, reader = ends
    writer.reuse(reader.released())
    return reader.read(writer.write(content))


def test_contents_of_any_type_and_size(ends: Ends) -> None:
    rng = np.random.default_rng(0)
    for size in (0, 1, 1000, 10**5, 10**6):
        content = {"a": [rng.random(size), rng.random((size, 2)).astype("f4")], "b": (np.arange(size), None, "x")}
        got = sent(ends, content)
        np.testing.assert_equal(got, content)
        assert all(array.flags.writeable and array.flags.aligned for array in got["a"])


def test_memory_is_used_again_when_its_arrays_are_gone(ends: Ends) -> None:
    kept = sent(ends, np.full(10**5, 3.0))[7:9]
    for turn in range(20):
        assert sent(ends, np.full(10**5, float(turn)))[-1] == turn
    size = os.fstat(ends[1].file).st_size
    assert kept.tolist() == [3.0, 3.0] and size < 4 * 2**20
    del kept
    for turn in range(20):
        sent(ends, np.full(10**5, float(turn)))
    assert os.fstat(ends[1].file).st_size == size


def test_arrays_outlive_the_blocks(ends: Ends) -> None:
    kept = sent(ends, np.full(10**5, 3.0))
    ends[1].close()
    assert kept[-1] == 3.0


def test_memory_has_no_name(ends: Ends) -> None:
    sent(ends, np.zeros(10**5))
    assert os.fstat(ends[1].file).st_nlink == 0
