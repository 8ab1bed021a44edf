"""Files of moving pictures: what stands is one frame that lasts, and what cannot be written is refused before."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from coopsim.bench.safety import movie
from coopsim.bench.safety.movie import require_movie, write_movie
from coopsim.errors import InvalidValueError, MissingDependencyError


def frames() -> list[Image.Image]:
    red, blue = (Image.new("RGB", (64, 36), color) for color in ("red", "blue"))
    return [red] * 10 + [blue] * 5


def test_a_gif_lasts_as_long_as_its_frames(tmp_path: Path) -> None:
    path = write_movie(tmp_path / "a.gif", frames(), 20)
    with Image.open(path) as found:
        assert found.n_frames == 2  # type: ignore[attr-defined]
        lasts = []
        for k in range(2):
            found.seek(k)
            lasts.append(found.info["duration"])
    assert lasts == [500, 250]


def test_what_is_no_movie_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidValueError, match=r"movie must end in \.gif or \.mp4, got .*a\.avi"):
        require_movie(tmp_path / "a.avi")
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingDependencyError, match=r"MP4 needs ffmpeg: .* a GIF needs nothing"):
        require_movie(tmp_path / "a.mp4")
