"""The report: one file, whole, that shows what was recorded and runs nothing that was not ours."""

from __future__ import annotations

import base64
import colorsys
import html
import io
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from coopsim.bench.report.bev_data import TURN_RAD, UNIT_M
from coopsim.bench.report.demo_report import ReportRun, ReportScene, render_report, write_report
from coopsim.bench.report.table import COLUMNS
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Tracks
from coopsim.viz import palette
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

FRAMES, SPEED_M = 5, 3000.0
"""The agent drives far, so that points would not fit if they were stored from where it began."""


def boxes(k: int, *offsets: tuple[float, float, float]) -> Boxes3D:
    return Boxes3D.from_array([[k * SPEED_M + x, y, 0.8, 4.5, 1.9, 1.6, yaw] for x, y, yaw in offsets])


TRUTH = ((10.0, 2.0, 0.5), (-30.0, -4.0, -3.1))
REPORTED = ((10.3, 2.1, 0.4), (40.0, 9.0, 9.0), (-20.0, 0.0, -1.0))
IDS = (4, 1, 70000)


def bev(k: int) -> BevFrame:
    truth = boxes(k, *TRUTH)
    zeros = np.zeros(2, dtype=int)
    actors = Actors(np.array([1, 2]), truth, np.zeros((2, 2)), zeros, zeros, np.zeros((2, 3), np.uint8))
    body = AgentBody("cav_0", "cav", 1, SE3.from_xyz_yaw([k * SPEED_M, 0, 0], 0.0), 1.6)
    return BevFrame(
        k * 100_000_000, actors, {"cav_0": body}, np.array([[k * SPEED_M + 7.0, -3.0, 1.0], [1e9, 0, 0]]), {}
    )


def scene(**change: Any) -> ReportScene:
    road_map = RoadMap((np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 4.0]]),), (), (), ())
    given = ReportScene("a title", 0.1, road_map, [bev(k) for k in range(FRAMES)], {}, 0, {"seed": "7"})
    return replace(given, **change)


def run(label: str = "late_fusion, 0 ms", policy: str = "late_fusion", **values: float) -> ReportRun:
    reported = [
        {"cav_0": Tracks(np.array(IDS), boxes(k, *REPORTED), np.zeros((3, 2)), np.ones(3), np.zeros(3, dtype=int))}
        for k in range(FRAMES)
    ]
    row = {name: 1.0 for name, _ in COLUMNS} | values
    return ReportRun(label, {"policy": policy}, row, np.linspace(-1, 1, FRAMES), reported)


class Page(HTMLParser):
    """What a browser would see: elements with attributes, and the text of each."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.open: list[list[str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        text: list[str] = []
        self.elements.append((tag, dict(attrs), text))
        if tag not in {"meta", "img", "input"}:  # these have no end
            self.open.append(text)

    def handle_endtag(self, tag: str) -> None:
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open:
            self.open[-1].append(data)

    def texts(self, tag: str, css: str | None = None) -> list[str]:
        return ["".join(text) for name, attrs, text in self.elements if name == tag and attrs.get("class") == css]

    @property
    def data(self) -> Any:
        (text,) = [text for _, attrs, text in self.elements if attrs.get("type") == "application/json"]
        return json.loads("".join(text))


def stored(text: str, dtype: str, columns: int) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype).reshape(-1, columns)


def test_one_file_that_fetches_nothing() -> None:
    image = np.full((24, 32, 3), 200, np.uint8)
    text = render_report(scene(cameras={"cav_0": {"front": image}}), [run(), run(policy="other")])
    for tag, attributes, _ in Page(text).elements:
        assert tag not in {"link", "iframe", "object", "embed", "base"}
        for name in ("src", "href", "srcset", "action", "data"):
            assert (attributes.get(name) or "data:").startswith("data:"), (tag, attributes)
    assert not re.search(r"https?:|url\(|@import|\bfetch\b|XMLHttpRequest|WebSocket|\bimport\b", text)


HOSTILE = [
    "</script><script>alert(1)</script>",
    "<!--<script>",
    "\"' onmouseover='alert(1)",
    "a & b &lt; c",
    "$title ${data} $$",
    "line\u2028separator",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_labels_stay_text(text: str) -> None:
    plain = Page(render_report(scene(cameras={"a": {"b": np.zeros((2, 2, 3), np.uint8)}}), [run()]))
    hostile_run = replace(run(label=text, policy=text), tracks=[{text: Tracks.empty()}] * FRAMES)
    cameras = {text: {text: np.zeros((2, 2, 3), np.uint8)}}
    page = Page(render_report(scene(title=text, settings={text: text}, cameras=cameras), [hostile_run]))
    assert [(tag, attrs.keys()) for tag, attrs, _ in page.elements] == [
        (tag, attrs.keys()) for tag, attrs, _ in plain.elements
    ]
    assert page.texts("title") == page.texts("h1") == [text]
    assert page.texts("td", "about") == [text] and text in page.texts("dd")
    assert page.data["runs"][0]["label"] == text and list(page.data["runs"][0]["tracks"][0]) == [text]


def test_nothing_in_the_data_looks_like_a_tag() -> None:
    # Browsers end a script element, or do not, by rules that HTMLParser does not know ("<!--<script>").
    text = render_report(scene(), [run(label=label) for label in HOSTILE])
    data = text.split('id="data">')[1].split("</script>")[0]
    assert len(data) > 1000 and "<" not in data


def test_data_are_what_was_recorded_however_far_it_drove() -> None:
    data = Page(render_report(scene(), [run(), run(policy="other")])).data
    home_x = FRAMES // 2 * SPEED_M
    assert len(data["frames"]) == FRAMES and data["dt_s"] == 0.1
    assert [len(each["tracks"]) for each in data["runs"]] == [FRAMES, FRAMES]
    assert data["runs"][0]["score"] == [-1, -0.5, 0, 0.5, 1]
    for k, frame in enumerate(data["frames"]):
        assert frame["agents"] == [["cav_0", k * SPEED_M - home_x, 0.0, True]]
        home, origin = np.array([home_x, 0]), np.add(frame["origin"], [home_x, 0])
        points = stored(frame["points"], "<i2", 2) * UNIT_M + origin
        np.testing.assert_allclose(points, [[k * SPEED_M + 7, -3]], atol=UNIT_M)
        for text, expected in (
            (frame["truth"], boxes(k, *TRUTH)),
            (data["runs"][0]["tracks"][k]["cav_0"], boxes(k, *REPORTED)),
        ):
            rows = stored(text, "<i4", 6)
            np.testing.assert_allclose(rows[:, 1:3] * UNIT_M + home, expected.center[:, :2], atol=UNIT_M)
            np.testing.assert_allclose(rows[:, 3:5] * UNIT_M, expected.size[:, :2], atol=UNIT_M)
            turned = np.exp(1j * rows[:, 5] * TURN_RAD)
            np.testing.assert_allclose(turned, np.exp(1j * expected.yaw), atol=2 * TURN_RAD)
    np.testing.assert_array_equal(data["map"]["lanes"][0], [[-home_x, 0], [9 - home_x, 0], [9 - home_x, 4]])


def test_an_id_has_the_same_colour_in_every_frame_run_and_picture() -> None:
    data = Page(render_report(scene(), [run(), run(policy="other")])).data
    ids = {tuple(stored(frame["cav_0"], "<i4", 6)[:, 0]) for each in data["runs"] for frame in each["tracks"]}
    assert ids == {IDS}
    for track_id in IDS:
        hue = track_id * data["hue_step"] % 1  # as the script has it
        rgb = colorsys.hls_to_rgb(hue, data["lightness"], data["saturation"])
        np.testing.assert_allclose(np.array(rgb) * 255, palette.track_color(track_id), atol=0.5)


def marked(page: Page) -> list[str]:
    return page.texts("td", "best")


def test_the_best_of_each_column_is_marked_where_there_is_one() -> None:
    good = run(policy="good", sAMOTA=50, FP=3, MOTP=float("nan"), **{"frames/s": 99})
    bad = run(policy="bad", sAMOTA=40, FP=9, MOTP=30.0, **{"frames/s": 1})
    assert marked(Page(render_report(scene(), [bad, good]))) == ["50.0", "3"]
    nearly = run(policy="nearly", sAMOTA=50.01, FP=3)
    assert marked(Page(render_report(scene(), [good, nearly]))) == [], "what looks alike is alike"
    assert "-" in Page(render_report(scene(), [good])).texts("td")


def test_cameras_and_settings_are_shown() -> None:
    image = np.zeros((24, 32, 3), np.uint8)
    image[:, :16] = 250
    page = Page(render_report(scene(cameras={"cav_0": {"front": image}}, camera_time_ns=1_500_000_000), [run()]))
    ((_, attributes, _),) = [element for element in page.elements if element[0] == "img"]
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode((attributes["src"] or "").split(",")[1]))))
    assert shown.shape == image.shape and np.abs(shown.astype(int) - image).mean() < 5
    assert "All cameras at 1.5 s." in page.texts("p", "note")
    assert "No camera pictures were taken in this run." in Page(render_report(scene(), [run()])).texts("p", "note")
    assert page.texts("dt")[-1] == "seed" and page.texts("dd")[-1] == "7"


@pytest.mark.parametrize(
    ("shown", "runs", "match"),
    [
        (scene(), [], "at least one run and one frame, got 0 and 5"),
        (scene(frames=[]), [run()], "at least one run and one frame, got 1 and 0"),
        (scene(frames=[bev(0)]), [run()], "run 'late_fusion, 0 ms' must have .* 1 frames, got 5 and 5"),
        (scene(), [replace(run(), frame_score=np.zeros(2))], "got 5 and 2"),
    ],
)
def test_what_does_not_fit_together_is_refused(shown: ReportScene, runs: Sequence[ReportRun], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        render_report(shown, runs)


def test_the_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    assert write_report(path, scene(), [run()]) == path
    before = path.read_bytes()
    assert html.unescape(before.decode()).count("a title") == 2
    with pytest.raises(UnicodeEncodeError):  # a lone surrogate: the file is open by then
        write_report(path, scene(title="\ud800"), [run()])
    assert path.read_bytes() == before
    write_report(path, scene(title="another"), [run()])
    assert "another" in path.read_text() and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("path", ["missing/report.html", "."])
def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, path: str) -> None:
    with pytest.raises(InvalidValueError, match=re.escape(f"cannot write {tmp_path / path}: ")):
        write_report(tmp_path / path, scene(), [run()])
    assert list(tmp_path.iterdir()) == []
