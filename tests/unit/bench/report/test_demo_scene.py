"""The scene of a report: shows what was recorded, and runs nothing that was not ours."""

from __future__ import annotations

import base64
import colorsys
import html
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import HOSTILE, Page
from PIL import Image

from coopsim.bench.films.film import ALL, TURN_RAD, FilmFrame, to_rows
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.report.bench_report import About, render_bench_report, write_bench_report
from coopsim.bench.report.film_data import UNIT_M
from coopsim.bench.report.scene import Scene, SceneRun
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.viz import palette
from coopsim.viz.bev import BevFrame, footprints
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

FRAMES, SPEED_M = 5, 3000.0
"""The agent drives far, so that points would not fit if they were stored from where it began."""


def boxes(k: int, *offsets: tuple[float, float, float]) -> Boxes3D:
    return Boxes3D.from_array([[k * SPEED_M + x, y, 0.8, 4.5, 1.9, 1.6, yaw] for x, y, yaw in offsets])


TRUTH = ((10.0, 2.0, 0.5), (-30.0, -4.0, -3.1))
REPORTED = ((10.3, 2.1, 0.4), (40.0, 9.0, 9.0), (-20.0, 0.0, -1.0))
IDS = (4, 1, 70000)


def bev(k: int) -> FilmFrame:
    truth = boxes(k, *TRUTH)
    zeros = np.zeros(2, dtype=int)
    actors = Actors(np.array([1, 2]), truth, np.zeros((2, 2)), zeros, zeros, np.zeros((2, 3), np.uint8))
    body = AgentBody("cav_0", "cav", 1, SE3.from_xyz_yaw([k * SPEED_M, 0, 0], 0.0), 1.6)
    points = np.array([[k * SPEED_M + 7.0, -3.0, 1.0], [1e9, 0, 0]])
    return FilmFrame.of(BevFrame(k * 100_000_000, actors, {"cav_0": body}, points, {}), {ALL: points})


def run(label: str = "late_fusion, 0 ms", policy: str = "late_fusion") -> SceneRun:
    reported = [{"cav_0": to_rows(np.array(IDS), footprints(boxes(k, *REPORTED)))} for k in range(FRAMES)]
    return SceneRun(label, policy, np.linspace(-1, 1, FRAMES), reported)


def scene(*runs: SceneRun, **change: Any) -> Scene:
    road_map = RoadMap((np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 4.0]]),), (), (), ())
    given: dict[str, Any] = {"cameras": {}, "camera_time_ns": 0, "frames": [bev(k) for k in range(FRAMES)]}
    given |= {"dt_s": 0.1, "road_map": road_map, "runs": runs or [run()]}
    return Scene(**(given | change))


def render(shown: Scene | None = None, title: str = "a title", settings: Any = None, **values: Any) -> str:
    """A report of one condition; `values` are of policies, by name."""
    shown = shown or scene()
    results = [
        CellResult(Cell(each.policy, Condition()), values.get(each.policy, {"sAMOTA": 1.0})) for each in shown.runs
    ]
    about = About(title, settings={"seed": "7"} if settings is None else settings)
    return render_bench_report(ResultTable.of(results), about, scene=shown)


def stored(text: str, dtype: str, columns: int) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype).reshape(-1, columns)


def test_one_file_that_fetches_nothing() -> None:
    image = np.full((24, 32, 3), 200, np.uint8)
    text = render(scene(run(), run(policy="other"), cameras={"cav_0": {"front": image}}))
    for tag, attributes, _ in Page(text).elements:
        assert tag not in {"link", "iframe", "object", "embed", "base"}
        for name in ("src", "href", "srcset", "action", "data"):
            assert (attributes.get(name) or "data:").startswith("data:"), (tag, attributes)
    addresses = set(re.findall(r"https?:[^\"'\s]*", text))
    assert addresses == {"http://www.w3.org/2000/svg"}, "a name, and nothing to fetch"
    assert not re.search(r"url\(|@import|\bfetch\b|XMLHttpRequest|WebSocket|\bimport\b", text)


@pytest.mark.parametrize("text", HOSTILE)
def test_labels_stay_text(text: str) -> None:
    plain = Page(render(scene(cameras={"a": {"b": np.zeros((2, 2, 3), np.uint8)}})))
    hostile_run = replace(run(label=text, policy=text), tracks=[{text: np.zeros((0, 6), np.int32)}] * FRAMES)
    cameras = {text: {text: np.zeros((2, 2, 3), np.uint8)}}
    page = Page(render(scene(hostile_run, cameras=cameras), text, {text: text}))
    assert [(tag, attrs.keys()) for tag, attrs, _ in page.elements] == [
        (tag, attrs.keys()) for tag, attrs, _ in plain.elements
    ]
    assert page.texts("title") == page.texts("h1") == [text]
    assert text in page.texts("td", "about") and text in page.texts("dd")
    runs = page.data["scene"]["runs"]
    assert runs[0]["label"] == text and list(runs[0]["tracks"][0]) == [text]


def test_nothing_in_the_data_looks_like_a_tag() -> None:
    # Browsers end a script element, or do not, by rules that HTMLParser does not know ("<!--<script>").
    text = render(scene(*(run(label=label, policy=label) for label in HOSTILE)))
    data = text.split('id="data">')[1].split("</script>")[0]
    assert len(data) > 1000 and "<" not in data


def test_data_are_what_was_recorded_however_far_it_drove() -> None:
    data = Page(render(scene(run(), run(policy="other")))).data["scene"]
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
    data = Page(render(scene(run(), run(policy="other")))).data
    ids = {tuple(stored(frame["cav_0"], "<i4", 6)[:, 0]) for each in data["scene"]["runs"] for frame in each["tracks"]}
    assert ids == {IDS}
    drawing = data["drawing"]
    for track_id in IDS:
        hue = track_id * drawing["hue_step"] % 1  # as the script has it
        rgb = colorsys.hls_to_rgb(hue, drawing["lightness"], drawing["saturation"])
        np.testing.assert_allclose(np.array(rgb) * 255, palette.track_color(track_id), atol=0.5)


def test_the_best_of_each_column_is_marked_where_there_is_one() -> None:
    def marked(**values: Any) -> list[str]:
        page = Page(render(scene(*(run(policy=name) for name in values)), **values))
        return page.texts("td", "best")

    good, bad = {"sAMOTA": 50.0, "FP": 3.0, "MOTP": float("nan")}, {"sAMOTA": 40.0, "FP": 9.0, "MOTP": 30.0}
    assert marked(good=good, bad=bad) == ["50.0", "3.0"]
    assert marked(good=good, nearly=good | {"sAMOTA": 50.01}) == [], "what looks alike is alike"
    assert "-" in Page(render(scene(run(policy="good")), good=good)).texts("td")


def test_cameras_and_settings_are_shown() -> None:
    image = np.zeros((24, 32, 3), np.uint8)
    image[:, :16] = 250
    page = Page(render(scene(cameras={"cav_0": {"front": image}}, camera_time_ns=1_500_000_000)))
    ((_, attributes, _),) = [element for element in page.elements if element[0] == "img"]
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode((attributes["src"] or "").split(",")[1]))))
    assert shown.shape == image.shape and np.abs(shown.astype(int) - image).mean() < 5
    assert "All cameras at 1.5 s." in page.texts("p", "note")
    assert "No camera images were taken in this run." in Page(render()).texts("p", "note")
    assert "seed" in page.texts("dt") and "7" in page.texts("dd")


def test_without_a_scene_its_sections_are_left_out() -> None:
    table = ResultTable.of([CellResult(Cell("a", Condition()), {"sAMOTA": 1.0})])
    page = Page(render_bench_report(table, About()))
    assert not {"From above", "Reward over time", "Cameras"}.intersection(page.texts("h2")) and "scene" not in page.data
    assert {"From above", "Reward over time", "Cameras"} <= set(Page(render()).texts("h2"))


def write(path: Path, title: str) -> Path:
    table = ResultTable.of([CellResult(Cell("a", Condition()), {"sAMOTA": 1.0})])
    return write_bench_report(path, table, About(title), scene=scene())


def test_the_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    assert write(path, "a title") == path
    before = path.read_bytes()
    assert html.unescape(before.decode()).count("a title") == 2
    with pytest.raises(UnicodeEncodeError):  # a lone surrogate: the file is open by then
        write(path, "\ud800")
    assert path.read_bytes() == before
    write(path, "another")
    assert "another" in path.read_text() and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("path", ["missing/report.html", "."])
def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, path: str) -> None:
    with pytest.raises(InvalidValueError, match=re.escape(f"cannot write {tmp_path / path}: ")):
        write(tmp_path / path, "a title")
    assert list(tmp_path.iterdir()) == []


def test_a_page_has_the_lights_of_each_frame_and_bars_at_their_lines() -> None:
    line = np.array([[2.0, 5.0], [-2.0, 5.0]])
    given = scene(run())
    frames = [replace(frame, lights=letter) for frame, letter in zip(given.frames, "Ggyrr", strict=True)]
    data = replace(given, road_map=replace(given.road_map, stop_lines=(line,)), frames=frames).data()
    assert [frame["lights"] for frame in data["frames"]] == list("Ggyrr")
    assert np.shape(data["map"]["bars"]) == (1, 4, 2) and scene(run()).data()["map"]["bars"] == []
