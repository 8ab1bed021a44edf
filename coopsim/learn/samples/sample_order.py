"""The order of a training's samples: a pure function of the seed, so that a resumed training sees the same ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.errors import TrainingError
from coopsim.learn.clips.clip import ClipSource
from coopsim.support.rng import stream

_MOST_EMPTY = 20
"""Blocks in a row without any sample, after which a training gives up."""


Cut = Callable[[Any, np.random.Generator], Sequence[Any]]
"""Draws samples from a clip."""

Join = Callable[[Sequence[Any]], Any]
"""Makes a batch of samples."""


@dataclass(frozen=True, slots=True, order=True)
class Position:
    """Position of a training in its data.

    Attributes:
        block: number of the block, from 0.
        turn: number of the pass over it, from 0.
        batches: batches of that pass that are used.
    """

    block: int = 0
    turn: int = 0
    batches: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class SampleOrder:
    """Batches of a training, in order.

    Clips are read in blocks, in order of their index. All samples of a block are shuffled; a block is used several
    times, each time cut and shuffled anew. Samples that do not fill a batch are left out.

    Attributes:
        source: clips.
        cut: draws samples from a clip.
        seed: seed of cuts and shuffles.
        batch: samples in a batch.
        block: clips in a block.
        passes: passes over each block.
        join: makes a batch of samples.
    """

    source: ClipSource
    cut: Cut
    seed: int
    batch: int
    block: int
    passes: int
    join: Join = list

    def batches(self, start: Position) -> Iterator[tuple[Position, Any]]:
        """Yield batches without end, each with the position after it.

        Raises:
            TrainingError: many blocks in a row have no sample.
        """
        return joined_blocks(self.batches_of_block, start, self.block)

    def batches_of_block(self, start: Position) -> Iterator[tuple[Position, Any]]:
        """Yield the batches of a block from a position in it on, each with the position after it."""
        block, turn, used = start.block, start.turn, start.batches
        clips = [self.source.clip(block * self.block + k) for k in range(self.block)]
        while turn < self.passes:
            found = self._shuffled(clips, block, turn)
            while used < len(found):
                used += 1
                yield Position(block, turn, used), self.join(found[used - 1])
            turn, used = turn + 1, 0

    def _shuffled(self, clips: Sequence[Any], block: int, turn: int) -> list[list[Any]]:
        """Return all full batches of one pass over a block; a block of fewer samples than a batch is one batch."""
        owners = ("0", str(block), str(turn))
        samples: list[Any] = []
        for k, clip in enumerate(clips):
            samples += self.cut(clip, stream(self.seed, "training.cut", *owners, str(k)))
        places = stream(self.seed, "training.shuffle", *owners).permutation(len(samples)).tolist()
        size = min(self.batch, len(samples))
        full = len(samples) // size if size else 0
        return [[samples[place] for place in places[k * size : (k + 1) * size]] for k in range(full)]


def joined_blocks(
    batches_of_block: Callable[[Position], Iterator[tuple[Position, Any]]], start: Position, clips: int
) -> Iterator[tuple[Position, Any]]:
    """Yield the batches of all blocks from a position on.

    Args:
        batches_of_block: yields those of one block from a position in it on.
        start: the position.
        clips: number of clips of a block, for the error.

    Raises:
        TrainingError: many blocks in a row have no sample.
    """
    empty = 0
    while True:
        empty += 1
        for each in batches_of_block(start):
            empty = 0
            yield each
        start = Position(start.block + 1)
        if empty >= _MOST_EMPTY:
            raise TrainingError(
                f"{empty * clips} clips up to number {start.block * clips - 1} have no sample: the recipe's world must "
                "have agents that see something (with cameras, to train on pictures)"
            )
