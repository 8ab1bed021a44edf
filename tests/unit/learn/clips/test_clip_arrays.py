from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.clips import require_same, small_clip

from coopsim.learn.clips.clip_arrays import arrays_of, clip_of


def test_steps_between_points_wrap_around() -> None:
    arrays = arrays_of(small_clip())
    assert arrays["steps_cm"].dtype == np.int16 and arrays["steps_cm"].shape[1] == arrays["points"].sum()
    require_same(clip_of(arrays), small_clip())


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("format", lambda array: array + 1, "this version of coopsim reads 1 and 2"),
        ("boxes", lambda array: array * np.nan, "boxes must be rows of 7 finite"),
        ("boxes", lambda array: -array, "sizes > 0"),
        ("boxes", lambda array: array[1:], "different lengths"),
        ("label", lambda array: array + 9, r"label must be in 0\.\.8"),
        ("label", lambda array: array.astype(float), "label must be integers"),
        ("agents", lambda array: array + 1, "different lengths"),
        ("points", lambda array: -array, "different lengths"),
        ("returns", lambda array: array[:-1], "different lengths"),
        ("xyz_yaw", lambda array: array[:, :3], "xyz_yaw must be rows of 4"),
        ("intensity", lambda array: array[:-1], "steps_cm"),
        ("steps_cm", lambda array: array.astype(np.int64), "int16"),
        ("kind", lambda array: array[:-1], "different lengths"),
    ],
)
def test_arrays_of_no_clip_are_refused(name: str, change: Any, message: str) -> None:
    arrays = dict(arrays_of(small_clip()))
    arrays[name] = change(arrays[name])
    with pytest.raises(ValueError, match=message):
        clip_of(arrays)
