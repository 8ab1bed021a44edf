"""Files of moving pictures: GIF by pillow, MP4 by ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

from PIL import Image

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.support.files import require_writable

FRAMES_PER_S = {".gif": 10, ".mp4": 20}
"""Frames a second by ending: a GIF stores whole pictures, and one in a page is loaded by everyone who opens it."""

_GIF_WIDTH_PX, _GIF_COLORS = 960, 96
"""Width and colours of a GIF: 30 s stay below what programs for slides and mail take."""


def require_movie(path: Path) -> None:
    """Raise an error if a movie cannot be written there: to be called before it is drawn.

    Raises:
        InvalidValueError: its name is not that of a movie, or nothing can be written there.
        MissingDependencyError: it is an MP4, and there is no ffmpeg.
    """
    if path.suffix.lower() not in FRAMES_PER_S:
        raise InvalidValueError(f"movie must end in {' or '.join(FRAMES_PER_S)}, got {str(path)!r}")
    if path.suffix.lower() == ".mp4":
        find_ffmpeg()
    require_writable(path)


def write_movie(path: Path, frames: Iterable[Image.Image], frames_per_s: int) -> Path:
    """Write frames of one size, at least one, as a GIF or an MP4, by the path's ending."""
    require_movie(path)
    (_write_mp4 if path.suffix.lower() == ".mp4" else _write_gif)(path, frames, frames_per_s)
    return path


def _write_gif(path: Path, frames: Iterable[Image.Image], frames_per_s: int) -> None:
    """Write a GIF, all frames of which have the same colours, or single pixels would flicker."""
    found, lasts_ms = list[Image.Image](), list[int]()
    previous: Image.Image | None = None
    for frame in frames:
        if frame is previous:  # a standing picture is one frame that lasts
            lasts_ms[-1] += round(1000 / frames_per_s)
            continue
        previous = frame
        height = round(frame.height * _GIF_WIDTH_PX / frame.width)
        found.append(frame.resize((_GIF_WIDTH_PX, height), Image.Resampling.LANCZOS))
        lasts_ms.append(round(1000 / frames_per_s))
    # By octree: few pixels in red, which a median cut would lose, are what matters.
    palette = _side_by_side(found[:: max(1, len(found) // 6)]).quantize(_GIF_COLORS, Image.Quantize.FASTOCTREE)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in found]
    drawn[0].save(path, save_all=True, append_images=drawn[1:], duration=lasts_ms, loop=0, optimize=False)


def _side_by_side(frames: Sequence[Image.Image]) -> Image.Image:
    width, height = frames[0].size
    whole = Image.new("RGB", (width * len(frames), height))
    for k, frame in enumerate(frames):
        whole.paste(frame, (k * width, 0))
    return whole


def _write_mp4(path: Path, frames: Iterable[Image.Image], frames_per_s: int) -> None:
    """Write an MP4 that browsers and programs for slides play: H.264 with 4:2:0 colours."""
    frames = iter(frames)
    first = next(frames)
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}", "-r", str(frames_per_s)]
    coded = ["-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    command = [find_ffmpeg(), "-y", "-loglevel", "error", *raw, "-i", "-", *coded, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            for frame in chain([first], frames):
                process.stdin.write(frame.tobytes())
            process.stdin.close()
        except BrokenPipeError:  # it ended, and says why
            pass
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise InvalidValueError(f"ffmpeg cannot write {path}: {said or f'it ended with {process.returncode}'}")


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: the machine's, or the one that imageio-ffmpeg brings.

    Raises:
        MissingDependencyError: there is none.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        import imageio_ffmpeg
    except ImportError:
        problem = "MP4 needs ffmpeg: install it, or pip install 'coopsim[video]'; a GIF needs nothing"
        raise MissingDependencyError(problem) from None
    return str(imageio_ffmpeg.get_ffmpeg_exe())
