"""Take pictures and films of pages, such as reports, in a Chromium without a screen, with plain Python.

    python scripts/picture_pages.py shot PAGE.html OUT.png [--hash t=4] [--dark] [--size 1200x800] [--of SELECTOR]
    python scripts/picture_pages.py film PAGE.html OUT.gif [--hash view=seat] [--dark] [--size 640x400] [--colors 64]
    python scripts/picture_pages.py time PAGE.html [--size 800x600]

`film` plays the first view in three dimensions of a page, frame by frame; `time` says how long it draws a frame. The
browser is that of `--chromium` or COOPSIM_CHROMIUM, or else the first of `NAMES` that is installed.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    *("--headless=new", "--remote-debugging-pipe", "--no-first-run", "--hide-scrollbars", "--mute-audio"),
    *("--enable-unsafe-swiftshader", "--disable-extensions", "--disable-background-networking", "--no-sandbox"),
)
"""Flags of the browser: without a graphics card it draws in three dimensions on the processor."""

DRAWN = (
    "new Promise((done) => { const place = document.querySelector('[data-space]');"
    "const seen = () => place && place.getBoundingClientRect().top < innerHeight;"
    "const look = () => !seen() || spaceViews.length ? done(true) : setTimeout(look, 20); look(); })"
)
"""Script that waits until the page's view in three dimensions is drawn, if any of it is in the window."""

READY = f"document.querySelector('[data-space]').scrollIntoView(), {DRAWN}"
"""Script that brings this view into sight, where it begins, and waits until it is drawn."""


def find_chromium(given: str | None = None) -> str | None:
    """Return the path of a Chromium; None: there is none."""
    named = given or os.environ.get("COOPSIM_CHROMIUM")
    return shutil.which(named) if named else next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """A page in a browser, over a pair of pipes.

    Attributes:
        process: id of the browser's process.
        errors: what its scripts complained of.
    """

    def __init__(self, to_browser: int, from_browser: int, process: int) -> None:
        self._to, self._from, self.process = to_browser, from_browser, process
        self._left, self._number, self._session = b"", 0, ""
        self.errors: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the browser's protocol, and return its result.

        Raises:
            RuntimeError: the browser refuses, or is gone.
        """
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            got = self._read()
            if got.get("id") == self._number:
                if "error" in got:
                    raise RuntimeError(f"{method}: {got['error']['message']}")
                return got["result"]  # type: ignore[no-any-return]
            self._listen(got)

    def open(self, page: Path, fragment: str, size: tuple[int, int], *, dark: bool = False, scale: float = 1) -> None:
        """Open a file at a size in px, and wait until it is there."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=scale, mobile=False
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url="about:blank")  # or another fragment of a page would be no new page
        self.call("Page.navigate", url=f"{page.resolve().as_uri()}{'#' if fragment else ''}{fragment}")
        while not self.run("location.protocol === 'file:' && document.readyState === 'complete'"):
            time.sleep(0.02)

    def run(self, expression: str) -> Any:
        """Return the value of an expression in the page; promises are awaited.

        Raises:
            RuntimeError: it throws.
        """
        got = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in got:
            why = got["exceptionDetails"].get("exception", {}).get("description", "the page threw")
            raise RuntimeError("\n".join([*self.errors, why]))
        return got["result"].get("value")

    def picture(self, selector: str | None = None) -> Image.Image:
        """Return the window as it is shown, or a part of the page."""
        clip = {}
        if selector:
            box = f"(() => {{ const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
            x, y, width, height = self.run(f"{box} return [r.x + scrollX, r.y + scrollY, r.width, r.height]; }})()")
            clip = {"clip": {"x": x, "y": y, "width": width, "height": height, "scale": 1}}
        taken = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=bool(clip), **clip)
        return Image.open(io.BytesIO(base64.b64decode(taken["data"]))).convert("RGB")

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._left:
            got = os.read(self._from, 2**20)
            if not got:
                raise RuntimeError("the browser is gone")
            self._left += got
        whole, _, self._left = self._left.partition(b"\0")
        return json.loads(whole)  # type: ignore[no-any-return]

    def _listen(self, told: dict[str, Any]) -> None:
        params = told.get("params", {})
        if told.get("method") == "Runtime.exceptionThrown":
            self.errors.append(params["exceptionDetails"].get("exception", {}).get("description", "an exception"))
        elif told.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])


@contextmanager
def browser(chromium: str, flags: Sequence[str] = FLAGS) -> Iterator[Page]:
    """Start a browser with an empty page, and end it in the end."""
    to_read, to_write = os.pipe()
    from_read, from_write = os.pipe()

    def as_three_and_four() -> None:
        os.dup2(os.dup(to_read), 3)
        os.dup2(os.dup(from_write), 4)

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [chromium, *flags, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=as_three_and_four,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)
        try:
            yield Page(to_write, from_read, process.pid)
        finally:
            os.close(to_write)
            process.terminate()
            process.wait()
            os.close(from_read)


def frames_of(page: Page, first: int, last: int | None, step: int) -> Iterator[Image.Image]:
    """Yield pictures of a page's first view in three dimensions, frame by frame."""
    page.run(READY)
    count = page.run("spaceViews[0].world.count")
    for frame in range(first, min(last or count, count), step):
        page.run(f"spaceViews[0].go({frame})")
        yield page.picture(".space-stage")


def write_film(path: Path, pictures: Sequence[Image.Image], colors: int, lasts_ms: int) -> None:
    """Write pictures of one size as a GIF or a WebP, by the path's ending."""
    if path.suffix == ".webp":
        pictures[0].save(
            path, save_all=True, append_images=pictures[1:], duration=lasts_ms, loop=0, quality=35, method=4
        )
        return
    sample = Image.new("RGB", (pictures[0].width, pictures[0].height * 3))
    for k, picture in enumerate((pictures[0], pictures[len(pictures) // 2], pictures[-1])):
        sample.paste(picture, (0, k * picture.height))
    palette = sample.quantize(colors, Image.Quantize.MEDIANCUT)
    drawn = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    drawn[0].save(path, save_all=True, append_images=drawn[1:], duration=lasts_ms, loop=0, optimize=False)


def processor_s(process: int) -> float:
    """Return the processor time of a process and all below it, s, as Linux counts it."""
    spent, parents = {}, {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = entry.read_text().rpartition(")")[2].split()
            number = int(entry.parent.name)
            parents[number], spent[number] = int(fields[1]), int(fields[11]) + int(fields[12])
    family = {process}
    while grown := {each for each, parent in parents.items() if parent in family} - family:
        family |= grown
    return sum(spent.get(each, 0) for each in family) / os.sysconf("SC_CLK_TCK")


def time_view(page: Page) -> str:
    """Return how long the first view of a page draws a frame, from outside and from the seat."""
    page.run(READY)
    lines = []
    for view in ("orbit", "seat"):
        page.run(f"spaceViews[0].choose('view', '{view}')")
        page.run("spaceViews[0].go(0)")
        before = processor_s(page.process)
        took = page.run(
            "(async () => { const view = spaceViews[0], gl = view.gl.gl, pixel = new Uint8Array(4), took = [];"
            "for (let k = 0; k < Math.min(view.world.count, 20); k++) {"
            "const began = performance.now(); await view.go(k);"
            "gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); took.push(performance.now() - began); }"
            "return took.sort((a, b) => a - b); })()"
        )
        spent_ms = 1000 * (processor_s(page.process) - before) / len(took)
        took_ms = f"median {took[len(took) // 2]:.0f} ms, slowest {took[-1]:.0f} ms a frame"
        lines.append(f"{view}: {took_ms}; {spent_ms:.0f} ms of processor time on all cores")
    size = page.run("[spaceViews[0].canvas.width, spaceViews[0].canvas.height].join(' x ')")
    return "\n".join([f"canvas {size}", *lines])


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main() -> int:
    """Read the arguments, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("kind", choices=("shot", "film", "time"))
    add("page", type=Path)
    add("out", type=Path, nargs="?")
    add("--chromium", help="path of the browser")
    add("--hash", default="", help="moment and view of the page, such as t=4&view=seat&agent=cav_1")
    add("--size", type=_size, default=(1200, 800), help="of the window, px (default: 1200x800)")
    add("--dark", action="store_true")
    add("--of", metavar="SELECTOR", help="part of the page (default: the window; of a view in 3D: .space-stage)")
    add("--run", action="append", default=[], help="script to run in the page first")
    add("--first", type=int, default=0, help="first frame of a film")
    add("--last", type=int, help="frame after the last one of a film")
    add("--step", type=int, default=1, help="frames from picture to picture of a film")
    add("--colors", type=int, default=64, help="of a GIF (default: %(default)s)")
    given = parser.parse_args()
    chromium = find_chromium(given.chromium)
    if chromium is None:
        print(f"a Chromium is needed: name it with --chromium, or install one of {', '.join(NAMES)}", file=sys.stderr)
        return 2
    with browser(chromium) as page:
        page.open(given.page, given.hash, given.size, dark=given.dark)
        for script in given.run:
            page.run(script)
        if given.kind == "time":
            print(time_view(page))
        elif given.kind == "film":
            pictures = list(frames_of(page, given.first, given.last, given.step))
            write_film(given.out, pictures, given.colors, 100 * given.step)
        else:
            page.run(READY if given.of == ".space-stage" else DRAWN)
            page.picture(given.of).save(given.out)
        for error in page.errors:
            print(error, file=sys.stderr)
    return 1 if page.errors else 0


if __name__ == "__main__":
    sys.exit(main())
