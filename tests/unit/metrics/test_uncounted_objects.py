"""Objects that do not count neither help nor harm, as if they and the tracks on them were not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from metric_sequences import generate

from coopsim.geometry.iou import iou_3d
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize


@pytest.mark.parametrize("seed", range(4))
def test_it_is_as_if_they_were_not_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    with_ignored, without = Evaluator(), Evaluator()
    left_out = 0
    for frame in generate(seed, gap_m=1.5, empty=0.1):
        counts = rng.random(len(frame.truth)) < 0.6
        overlap = iou_3d(frame.truth.boxes.array, frame.tracks.boxes.array) * frame.same_class()
        on_ignored, on_counted = (overlap[rows].max(axis=0, initial=0.0) for rows in (~counts, counts))
        kept = (on_ignored < 0.25) | (on_counted >= on_ignored)
        left_out += int((~kept).sum())
        marked = replace(frame.truth, counts=counts)
        assert with_ignored.update(marked, frame.tracks) == without.update(marked.counted, frame.tracks[kept])
    assert left_out > 10
    assert summarize([with_ignored.log]).to_dict() == summarize([without.log]).to_dict()
