from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from helpers.clips import require_same, seeing_clip, small_clip

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.learn.clips.clip import Clip, Scene
from coopsim.learn.clips.store import clip_bytes, load_clip, save_clip


def test_a_clip_reads_back_bit_by_bit(tmp_path: Path) -> None:
    clip = small_clip()
    save_clip(tmp_path / "one.npz", clip)
    require_same(load_clip(tmp_path / "one.npz"), clip)
    assert clip_bytes(clip) == (tmp_path / "one.npz").read_bytes()


def test_pictures_are_stored_in_a_tenth_of_their_bytes(tmp_path: Path) -> None:
    clip = seeing_clip()
    save_clip(tmp_path / "one.npz", clip)
    require_same(load_clip(tmp_path / "one.npz"), clip)
    pictures = sum(picture.rgb.nbytes for scene in clip.scenes for agent in scene.agents for picture in agent.pictures)
    assert len(clip_bytes(clip)) - len(clip_bytes(small_clip())) < pictures / 10


def test_frames_without_agents_or_objects_read_back(tmp_path: Path) -> None:
    nothing = Scene(
        5,
        (),
        np.zeros(0, np.int64),
        np.zeros((0, 7)),
        np.zeros((0, 2)),
        np.zeros(0, np.int64),
        np.zeros((0, 0), np.int64),
    )
    clip = Clip("empty", 0.5, (nothing, nothing))
    save_clip(tmp_path / "empty.npz", clip)
    require_same(load_clip(tmp_path / "empty.npz"), clip)


def test_a_clip_without_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="at least one frame"):
        save_clip(tmp_path / "none.npz", Clip("none", 0.5, ()))


def test_broken_files_are_refused_by_name(tmp_path: Path) -> None:
    good, path = clip_bytes(small_clip()), tmp_path / "broken.npz"
    rng = np.random.default_rng(0)
    for k in range(60):
        content = bytearray(good)
        if k < 20:
            content = content[: int(rng.integers(len(good)))]
        else:  # near the end, where the directory of the archive is, and anywhere
            first = len(good) - 1500 if k % 2 else 0
            content[int(rng.integers(first, len(good)))] ^= 0xFF
        path.write_bytes(content)
        with suppress(RecordingError):  # and no other; a changed byte that nobody reads harms nothing
            load_clip(path)
    path.write_bytes(good[:-30])
    with pytest.raises(RecordingError, match=r"broken\.npz"):
        load_clip(path)
    with pytest.raises(RecordingError, match="No such file"):
        load_clip(tmp_path / "missing.npz")


def test_pickled_objects_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "pickled.npz"
    np.savez(path, format=np.array([{}], dtype=object))
    with pytest.raises(RecordingError, match="pickle"):
        load_clip(path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(RecordingError, match="it has no array"):
        load_clip(path)
