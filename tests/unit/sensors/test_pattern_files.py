"""Beam tables from files: what is in them arrives, and what is wrong with them is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.lidar import LidarConfig
from coopsim.sensors.pattern_files import find_pattern, load_pattern

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


def test_azimuth_may_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("elevation_deg\n10\n-20\n")
    assert load_pattern(tmp_path / "mine.csv").azimuth_rad is None


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "", "has elevation_deg and may have azimuth_deg, got"),
        ("a.csv", "elevation_deg\n", "at least one beam"),
        ("a.csv", "10\n20\n", r"got \['10'\]"),
        ("a.csv", "elevation_deg,azimuth_deg\n1\n", "beam 1 has 1 values for 2 columns"),
        ("a.csv", "elevation_deg\n1\nup\n", "elevation_deg of beam 2 must be a number, got 'up'"),
        ("a.csv", "elevation_deg\n95\n", "within"),
        ("a.csv", "elevation_deg\nnan\n", "finite"),
        ("a.yaml", "- 1\n- 2\n", "a mapping with elevation_deg, got list"),
        ("a.yaml", "elevation: [1]\n", r"got \['elevation'\]"),
        ("a.yaml", "elevation_deg: [1, 2]\nazimuth_deg: [1]\n", "azimuth_rad must have shape"),
        ("a.yaml", "elevation_deg: [1, up]\n", "could not convert"),
        ("a.yaml", "elevation_deg: [1, [2]]\n", "a.yaml"),
        ("a.yaml", "elevation_deg: {", "is no YAML"),
        ("a.yaml", "!!python/object/apply:os.getcwd []\n", "is no YAML"),
    ],
)
def test_what_is_no_table_is_refused_by_its_file(tmp_path: Path, name: str, text: str, match: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InvalidValueError, match=match) as caught:
        load_pattern(tmp_path / name)
    assert name in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"cannot read the beam table .*nowhere\.csv"):
        find_pattern(str(tmp_path / "nowhere.csv"))


def test_what_ends_like_no_table_is_a_name() -> None:
    assert find_pattern("VLP-16").name == "VLP-16"
    with pytest.raises(UnknownNameError, match="Did you mean 'VLP-16'"):
        find_pattern("VLP-17")
