"""The script that draws the plots of results' pages: of the numbers that pages have, and all of them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import draw_results
import numpy as np
import pytest
from draw_results import PLOTS, RESULTS, read_plot


def cells(page: str, head: str) -> list[list[str]]:
    """Return the rows of the table with this head, without it."""
    rows = (RESULTS / page).read_text(encoding="utf-8").partition(head)[2].splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[: rows.index("")]]


def test_late_boxes_are_plotted_as_the_page_tells_them() -> None:
    parts, scenario = read_plot("latency"), ""
    for row in cells("delays_poses_budgets.md", "| scenario | latency | `as_current` |"):
        scenario = row[0].strip("`") or scenario
        for name, told in zip(("as_current", "predict", "replay"), row[2:5], strict=True):
            marks = parts[scenario][name]
            (shown,) = marks[marks[:, 0] == float(row[1].removesuffix(" ms")), 1]
            assert shown == pytest.approx(float(told), abs=0.05), row
            assert (marks[:, 2] < marks[:, 1]).all() and (marks[:, 1] < marks[:, 3]).all()


def test_detections_within_bytes_are_plotted_as_the_page_tells_them() -> None:
    (series,) = read_plot("detection_bytes").values()
    rows = {row[0]: row for row in cells("detection.md", "|  | rain 10 mm/h | VLP-16 |")}
    for name in ("late", "Where2comm", "GSAF", "V2VNet", "Where2comm, 64 channels"):
        told = [float(cell.split("/")[0]) for cell in rows[name][4:6]]
        np.testing.assert_allclose(series[name][:2, 1], told, atol=6e-4)
    assert series["early"][0, 1] == pytest.approx(0.611, abs=6e-4)


@pytest.mark.parametrize("plot", ["policy_speed", "speed", "sAMOTA_over_bytes"])
def test_a_plot_names_what_it_shows(plot: str) -> None:
    drawn = PLOTS[plot]()
    words = {"".join(each.itertext()).strip() for each in ET.fromstring(drawn).iter() if each.tag.endswith("}text")}
    series = {name for panel in read_plot(plot).values() for name in panel}
    if plot == "sAMOTA_over_bytes":
        series = {"early", "late_fusion", "where2comm(align=True)", "sends points"}
    assert series <= words, series - words


def test_the_files_are_as_the_script_draws_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["draw_results.py", "latency", "--out", str(tmp_path)])
    draw_results.main()
    assert [path.name for path in tmp_path.iterdir()] == ["latency.svg"]
    texts = [
        re.findall(r"<text[^>]*>(.*?)</text>", (folder / "latency.svg").read_text(encoding="utf-8"))
        for folder in (tmp_path, RESULTS)
    ]
    assert texts[0] == texts[1] and "as_current" in texts[0]
