"""The view in three dimensions in a browser: it draws, plays, and stays away in silence where there is no WebGL2."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coopsim.bench.demo import Demo, DemoConfig

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import picture_pages

CHROMIUM = picture_pages.find_chromium()
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
RINGS = """(() => {
    const [canvas, scene] = [document.querySelector("#panels canvas"), decodeScene({ ...data.drawing, ...data.scene })];
    const [id, x, y] = scene.frames[0].truth;
    const view = { agent: "cav_0", eye: [x * scene.unit, y * scene.unit], span: 40, layers: { tracks: true } };
    return [[], [], [[id, 0]], [[id, 0.5]]].map((cav_0) => {
        drawFromAbove(canvas, scene, 0, { ...scene.runs[0], news: [{ cav_0 }] }, view);
        return canvas.toDataURL();
    });
})()"""
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed, nor named by COOPSIM_CHROMIUM")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a short demonstration, under a strict policy of contents."""
    demo = Demo(DemoConfig(policies=("late_fusion",), latencies_s=(0.0,), frames=4, options={"lidar": "VLP-16"}))
    demo.run(lambda: None)
    path = demo.write_report(tmp_path_factory.mktemp("demo") / "demo.html")
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    path.write_text(path.read_text().replace("<head>", f"<head>{policy}", 1))
    return path


@pytest.fixture
def page() -> Iterator[Any]:
    """A page in a browser."""
    assert CHROMIUM is not None
    with picture_pages.browser(CHROMIUM) as page:
        yield page


@pytest.mark.heavy("a browser draws in software, beside the episode that it plays")
def test_it_draws_every_view_and_moves_with_time(report: Path, page: Any) -> None:
    pictures = {}
    for name, fragment, dark in (("outside", "", False), ("dark", "", True), ("seat", "view=seat", False)):
        page.open(report, fragment, (500, 700), dark=dark)
        page.run(picture_pages.READY)
        pictures[name] = np.asarray(page.picture(".space-stage"))
    assert all(each.std() > 10 for each in pictures.values()), "nothing is drawn"
    assert pictures["dark"].mean() < 80 < 150 < pictures["outside"].mean()
    assert np.abs(pictures["seat"].astype(int) - pictures["outside"]).mean() > 5
    page.run("spaceViews[0].go(3)")
    later = np.asarray(page.picture(".space-stage"))
    assert not np.array_equal(later, pictures["seat"]) and page.errors == []


@pytest.mark.heavy("a browser draws in software, beside the episode that it plays")
def test_a_lost_context_comes_back(report: Path, page: Any) -> None:
    page.open(report, "", (500, 700))
    page.run(picture_pages.READY)
    before = np.asarray(page.picture(".space-stage"))
    page.run(
        "(async () => { const gl = spaceViews[0].gl.gl, lose = gl.getExtension('WEBGL_lose_context');"
        "const back = new Promise((done) => spaceViews[0].canvas.addEventListener('webglcontextrestored', done));"
        "lose.loseContext(); setTimeout(() => lose.restoreContext(), 50); await back;"
        "await new Promise((done) => setTimeout(done, 300)); })()"
    )
    np.testing.assert_array_equal(np.asarray(page.picture(".space-stage")), before)
    assert page.errors == []


@pytest.mark.heavy("a browser, beside the episode that it plays")
def test_without_webgl_the_view_from_above_is_all(report: Path) -> None:
    assert CHROMIUM is not None
    with picture_pages.browser(CHROMIUM, [*picture_pages.FLAGS, "--disable-3d-apis"]) as page:
        page.open(report, "", (500, 700))
        hidden = page.run("document.querySelector('.space').hidden && document.querySelector('.space-bar') === null")
        drawn = page.run("document.querySelector('#panels canvas').width")
        bare, again, ringed, later = page.run(RINGS)
    assert hidden and drawn > 100 and page.errors == []
    assert bare == again and len({bare, ringed, later}) == 3, "a ring spreads about what a message has just told of"
