"""The order of samples: every sample once a pass, the same from any position on."""

from __future__ import annotations

from itertools import islice
from typing import Any, cast

import numpy as np
import pytest

from coopsim.errors import TrainingError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.samples.sample_order import Position, SampleOrder


class Numbers:
    """Clips that are named by their index."""

    def clip(self, index: int) -> Clip:
        return Clip(str(index), 0.1, ())


def cut(clip: Clip, rng: np.random.Generator) -> list[tuple[int, int, float]]:
    return [(int(clip.key), k, float(rng.random())) for k in range(3)]


ORDER = SampleOrder(Numbers(), cut, seed=5, batch=4, block=4, passes=2)


def taken(order: SampleOrder, count: int, start: Position | None = None) -> list[tuple[Position, list[Any]]]:
    return list(islice(order.batches(start or Position()), count))


def test_a_pass_has_every_sample_of_a_block_once_and_the_next_one_cuts_anew() -> None:
    batches = [batch for _, batch in taken(ORDER, 9)]
    passes = [[sample for batch in batches[k : k + 3] for sample in batch] for k in (0, 3, 6)]
    everyone = [[(clip, k) for clip in clips for k in range(3)] for clips in (range(4), range(4), range(4, 8))]
    assert [sorted(sample[:2] for sample in each) for each in passes] == everyone
    assert [sample[:2] for sample in passes[0]] != everyone[0]  # shuffled
    assert not {sample[2] for sample in passes[0]} & {sample[2] for sample in passes[1]}


def test_it_goes_on_from_any_position() -> None:
    whole = taken(ORDER, 12)
    for k in range(11):
        assert taken(ORDER, 11 - k, whole[k][0]) == whole[k + 1 :]


def test_samples_that_fill_no_batch_are_left_out_unless_there_are_no_others() -> None:
    assert [len(batch) for _, batch in taken(SampleOrder(Numbers(), cut, 0, 5, 4, 1), 4)] == [5, 5, 5, 5]
    assert [len(batch) for _, batch in taken(SampleOrder(Numbers(), cut, 0, 50, 4, 1), 2)] == [12, 12]


def test_seeds_have_their_own_draws() -> None:
    orders = [ORDER, SampleOrder(Numbers(), cut, 6, 4, 4, 2)]
    draws = [tuple(sample[2] for sample in taken(order, 1)[0][1]) for order in orders]
    assert len(set(draws)) == 2


def test_clips_without_samples_are_passed_over_but_not_forever() -> None:
    def some(clip: Clip, rng: np.random.Generator) -> list[Any]:
        return cut(clip, rng) if int(clip.key) > 20 else []

    assert taken(SampleOrder(Numbers(), some, 0, 3, 2, 2), 1)[0][1][0][0] >= 21
    nothing = cast(Any, lambda clip, rng: [])
    with pytest.raises(TrainingError, match="40 clips up to number 39 have no sample"):
        taken(SampleOrder(Numbers(), nothing, 0, 3, 2, 2), 1)
