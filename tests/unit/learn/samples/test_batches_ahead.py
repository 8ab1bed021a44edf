"""Batches that other processes make: the same as without them, and their errors."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pytest
import torch
from helpers.clip_sources import NumberedClips

from coopsim.errors import CoopsimError, InvalidValueError, TrainingError
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.learn.clips.pipe import receive, send
from coopsim.learn.samples.batches_ahead import BatchesAhead
from coopsim.learn.samples.sample_order import Position, SampleOrder


@dataclass(frozen=True)
class Numbered:
    """A maker of an order: three samples of each clip, none of clips whose number divides by `empty`."""

    source: ClipSource
    empty: int = 10**9

    def order(self) -> SampleOrder:
        return SampleOrder(self.source, self._cut, 5, 4, 4, 2, torch.tensor)

    def _cut(self, clip: Clip, rng: np.random.Generator) -> list[list[float]]:
        number = int(clip.key.split()[1])
        return [[number, k, float(rng.random())] for k in range(3)] if (number + 1) % self.empty else []


def taken(batches: Any, count: int) -> list[tuple[Position, list[Any]]]:
    return [(position, batch.tolist()) for position, batch in islice(batches, count)]


@pytest.mark.parametrize(
    ("workers", "start"),
    [
        (2, Position(1, 1, 2)),
        *(pytest.param(1, each, marks=pytest.mark.long) for each in (Position(), Position(1, 1, 2), Position(2, 2, 0))),
        *(pytest.param(3, each, marks=pytest.mark.long) for each in (Position(), Position(1, 1, 2), Position(2, 2, 0))),
    ],
)
def test_batches_are_those_of_the_order_for_any_number_of_workers(workers: int, start: Position) -> None:
    numbered = Numbered(NumberedClips(), empty=3)
    with BatchesAhead(numbered, 4, workers) as ahead:
        assert taken(ahead.batches(start), 20) == taken(numbered.order().batches(start), 20)


def test_errors_come_with_their_text() -> None:
    with BatchesAhead(Numbered(NumberedClips(fails_at=4, why="coopsim")), 4, 2) as ahead:
        batches = ahead.batches(Position())
        assert len(taken(batches, 6)) == 6
        with pytest.raises(InvalidValueError, match="no clip 4"):
            next(batches)
    with (
        BatchesAhead(Numbered(NumberedClips(fails_at=0, why="killed")), 4) as ahead,
        pytest.raises(CoopsimError, match="a batch of block 0 failed:\nits worker ended: SIGKILL"),
    ):
        next(ahead.batches(Position()))
    with (
        BatchesAhead(Numbered(NumberedClips(), empty=1), 4, 2) as ahead,
        pytest.raises(TrainingError, match="80 clips"),
    ):
        next(ahead.batches(Position()))


def test_arrays_and_tensors_pass_a_pipe_unchanged_and_writable() -> None:
    rows = np.arange(12.0).reshape(3, 4)
    sent: dict[str, Any] = {
        "array": rows,
        "turned": rows.T[::2],
        "tensor": torch.arange(5) > 2,
        "none": torch.zeros(0, 3),
        "text": "a",
    }
    inlet, outlet = (os.fdopen(each, mode, buffering=0) for each, mode in zip(os.pipe(), ("rb", "wb"), strict=True))
    with inlet, outlet:
        send(outlet, sent)
        outlet.close()
        got = receive(inlet)
        with pytest.raises(EOFError):
            receive(inlet)
    np.testing.assert_array_equal(got["array"], rows)
    np.testing.assert_array_equal(got["turned"], rows.T[::2])
    assert torch.equal(got["tensor"], sent["tensor"]) and got["none"].shape == (0, 3) and got["text"] == "a"
    got["array"][0, 0] = 1.0
    got["tensor"][0] = True
