from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from helpers.clips import require_same, small_clip

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.store import CachedClips


@dataclass
class CountedClips:
    """Clips that differ in their key; counts how many were made."""

    name: str = "counted"
    made: int = 0

    def clip(self, index: int) -> Clip:
        self.made += 1
        return replace(small_clip(), key=f"clip {index}")

    def __repr__(self) -> str:
        return self.name


def test_a_cached_clip_is_made_once_and_equals_a_fresh_one(tmp_path: Path) -> None:
    source = CountedClips()
    cached = CachedClips(source, tmp_path / "cache")
    require_same(cached.clip(3), cached.clip(3))
    require_same(CachedClips(source, tmp_path / "cache").clip(3), replace(small_clip(), key="clip 3"))
    assert source.made == 1
    cached.path(3).write_bytes(b"half a file")
    require_same(cached.clip(3), replace(small_clip(), key="clip 3"))
    assert source.made == 2


def test_a_folder_keeps_the_clips_of_one_source(tmp_path: Path) -> None:
    CachedClips(CountedClips(), tmp_path)
    with pytest.raises(InvalidValueError, match="another source, counted, not else"):
        CachedClips(CountedClips("else"), tmp_path)
