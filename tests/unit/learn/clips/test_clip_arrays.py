from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.clips import require_same, seeing_clip, small_clip

from coopsim.learn.clips.arrays import arrays_of, clip_of


def test_steps_between_points_wrap_around() -> None:
    arrays = arrays_of(small_clip())
    assert arrays["steps_cm"].dtype == np.int16 and arrays["steps_cm"].shape[1] == arrays["points"].sum()
    require_same(clip_of(arrays), small_clip())


def test_pictures_come_back_also_where_some_frames_and_agents_have_none() -> None:
    clip = seeing_clip()
    require_same(clip_of(arrays_of(clip)), clip)
    first, last = clip.scenes
    blind = replace(first.agents[0], pictures=())
    mixed = (replace(first, agents=(blind, *first.agents[1:])), *small_clip().scenes, last)
    require_same(clip_of(arrays_of(replace(clip, scenes=mixed))), replace(clip, scenes=mixed))


def test_arrays_of_the_first_format_are_read() -> None:
    kept = (
        "key dt_s time_ns agents objects name kind xyz_yaw odometry actor_id points steps_cm intensity object_id boxes"
    )
    arrays = arrays_of(small_clip())
    old = {name: arrays[name] for name in (*kept.split(), "velocity", "label", "returns")}
    read = clip_of({**old, "format": np.array(1)})
    require_same(read, small_clip())
    assert read.scenes[0].pixels is None and read.scenes[0].agents[0].pictures == ()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("format", lambda array: array + 2, "this version of coopsim reads 1 to 3"),
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
        ("counted", lambda array: array + 1, "counted must be 0 or 1"),
        ("pixels", lambda array: array[:-1], "different lengths"),
        ("cameras", lambda array: array + 1, "different lengths"),
        ("cameras", lambda array: -array, "cameras must be integers >= 0"),
        ("size", lambda array: 0 * array, "size must be rows of 2"),
        ("matrix", lambda array: array * np.nan, "matrix must be finite"),
        ("distortion", lambda array: array[:, :4], r"distortion must be finite numbers of 64 bits, \(5,\)"),
        ("rotation", lambda array: array[1:], "different lengths"),
        ("rgb", lambda array: array[3:], "different lengths"),
        ("rgb", lambda array: array.astype(np.int16), "rgb must be uint8"),
        ("depth_m", lambda array: -array, "depth_m must be finite numbers >= 0"),
        ("nearest_label", lambda array: array - 1, r"nearest_label must be in 0\.\.8, or 255"),
    ],
)
def test_arrays_of_no_clip_are_refused(name: str, change: Any, message: str) -> None:
    arrays = dict(arrays_of(seeing_clip()))
    arrays[name] = change(arrays[name])
    with pytest.raises(ValueError, match=message):
        clip_of(arrays)


def test_doubtful_boxes_are_kept_and_clips_without_them_stay_the_same() -> None:
    plain = small_clip()
    first, *others = plain.scenes
    boxes = np.array([[1.0, 2.0, 0.5, 4.0, 2.0, 1.5, 0.3], [9.0, 2.0, 0.5, 1.0, 1.0, 1.5, 0.0]])
    doubting = replace(plain, scenes=(replace(first, doubtful=boxes), *others))
    assert int(arrays_of(plain)["format"]) == 2 and "doubtful" not in arrays_of(plain)
    back = clip_of(arrays_of(doubting))
    np.testing.assert_array_equal(back.scenes[0].doubtful, boxes)
    assert all(scene.doubtful is None for scene in back.scenes[1:])
    for wrong in ({"doubts": np.array([3, 0])}, {"doubtful": np.zeros((2, 6))}, {"doubtful": np.full((2, 7), np.nan)}):
        with pytest.raises(ValueError, match=r"doubt|lengths"):
            clip_of({**arrays_of(doubting), **wrong})
