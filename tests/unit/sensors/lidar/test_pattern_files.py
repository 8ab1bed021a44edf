"""Beam tables from files: their content, and errors with file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.lidar.patterns import find_pattern, load_pattern

CSV = "elevation_deg,azimuth_deg\n10, 1.5\n-2.5,-1.5\n\n-20,0\n"
YAML = "elevation_deg: [10, -2.5, -20]\nazimuth_deg: [1.5, -1.5, 0]\n"


@pytest.mark.parametrize(("name", "text"), [("mine.csv", CSV), ("mine.yaml", YAML), ("mine.YML", YAML)])
def test_a_table_is_read(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    pattern = load_pattern(tmp_path / name)
    assert pattern.name == "mine"
    np.testing.assert_allclose(np.degrees(pattern.elevation_rad), [10.0, -2.5, -20.0])
    np.testing.assert_allclose(np.degrees(pattern.offset_rad), [1.5, -1.5, 0.0])
    assert len(LidarConfig(str(tmp_path / name)).beams.elevation_rad) == 3


def test_a_spreadsheets_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_bytes(b"\xef\xbb\xbfelevation_deg\r\n10\r\n-20\r\n")
    np.testing.assert_allclose(np.degrees(load_pattern(tmp_path / "mine.csv").elevation_rad), [10.0, -20.0])


def test_azimuth_may_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("elevation_deg\n10\n-20\n")
    assert load_pattern(tmp_path / "mine.csv").azimuth_rad is None


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "", r"^a.csv:1: a beam table has the columns elevation_deg and, if any, azimuth_deg, got \[\]"),
        ("a.csv", "elevation_deg\n", "at least one beam"),
        ("a.csv", "10\n20\n", r"got \['10'\]"),
        ("a.csv", "elevation_deg;azimuth_deg\n1;2\n", r"got \['elevation_deg;azimuth_deg'\]"),
        ("a.csv", "elevation_deg,elevation_deg\n1,2\n", "^a.csv:1: a beam table has the columns"),
        ("a.csv", "elevation_deg,azimuth_deg\n\n1\n", "^a.csv:3: a beam has 2 values, got 1"),
        ("a.csv", "elevation_deg\n1\nup\n", "^a.csv:3: elevation_deg must be a number, got 'up'"),
        ("a.csv", "elevation_deg\n90\n", r"^a.csv:2: elevation_deg must be a number in \(-90, 90\), got 90"),
        ("a.csv", "elevation_deg\nnan\n", "^a.csv:2: elevation_deg must be .*, got nan"),
        ("a.csv", "elevation_deg,azimuth_deg\n1,181\n", r"^a.csv:2: azimuth_deg must be in \[-180, 180\], got 181"),
        ("a.yaml", "- 1\n- 2\n", "^a.yaml:1: file: expected keys and values. Accepted: azimuth_deg, elevation_deg"),
        ("a.yaml", "", "^a.yaml:1: file: expected keys and values"),
        ("a.yaml", "elevation: [1]\n", "^a.yaml:1: unknown key 'elevation'. Did you mean 'elevation_deg'"),
        ("a.yaml", "azimuth_deg: [1]\n", "elevation_deg is missing"),
        ("a.yaml", "elevation_deg: 3\n", "^a.yaml:1: elevation_deg must be a list, got 3"),
        ("a.yaml", "elevation_deg: []\n", "at least one beam"),
        ("a.yaml", "elevation_deg: [1]\nelevation_deg: [2]\n", "^a.yaml:2: elevation_deg is there twice"),
        ("a.yaml", "elevation_deg: [1, 2]\nazimuth_deg: [1]\n", "2 elevation_deg need as many azimuth_deg, got 1"),
        ("a.yaml", "elevation_deg:\n- 1\n- up\n", "^a.yaml:3: elevation_deg must be a number .*, got 'up'"),
        ("a.yaml", "elevation_deg: [1, true]\n", "elevation_deg must be a number .*, got True"),
        ("a.yaml", "elevation_deg: [1, [2]]\n", "a.yaml"),
        ("a.yaml", "elevation_deg: {", "is no YAML"),
        ("a.yaml", "!!python/object/apply:os.getcwd []\n", "a.yaml"),
    ],
)
def test_bad_tables_are_refused_with_file_and_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str, match: str
) -> None:
    (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidValueError, match=match):
        load_pattern(name)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"cannot read the beam table .*nowhere\.csv"):
        find_pattern(str(tmp_path / "nowhere.csv"))


def test_other_suffixes_are_names() -> None:
    assert find_pattern("VLP-16").name == "VLP-16"
    with pytest.raises(UnknownNameError, match="Did you mean 'VLP-16'"):
        find_pattern("VLP-17")
