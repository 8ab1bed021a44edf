"""Beam tables: the data sheets' angles, and what a table of one's own must be."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.patterns import PATTERNS, BeamPattern


@pytest.mark.parametrize(
    ("name", "beams", "top_deg", "bottom_deg"),
    [
        ("VLP-16", 16, 15.0, -15.0),
        ("HDL-32E", 32, 10.67, -30.67),
        ("HDL-64E", 64, 2.0, -24.33),
        ("Pandar64", 64, 14.882, -24.897),
        ("OS1-128", 128, 21.2, -21.2),
    ],
)
def test_tables_span_what_the_data_sheets_say(name: str, beams: int, top_deg: float, bottom_deg: float) -> None:
    elevation = np.degrees(PATTERNS.get(name).elevation_rad)
    assert len(elevation) == beams
    np.testing.assert_allclose([elevation.max(), elevation.min()], [top_deg, bottom_deg], atol=1e-9)


def test_hdl_64e_has_two_blocks() -> None:
    step = -np.diff(np.degrees(PATTERNS.get("HDL-64E").elevation_rad))
    np.testing.assert_allclose(step[:31], 1 / 3, atol=0.001)
    np.testing.assert_allclose(step[31:], 0.5, atol=0.001)


def test_pandar64_is_finest_around_the_horizon_and_points_aside() -> None:
    pandar = PATTERNS.get("Pandar64")
    step = -np.diff(np.degrees(pandar.elevation_rad))
    assert step.min() > 0.15 and step.max() > 6.0
    np.testing.assert_allclose(step[5:53], 1 / 6, atol=0.01)
    assert sorted(set(np.round(np.degrees(pandar.offset_rad), 3))) == [-5.208, -3.125, -1.042, 1.042, 3.125, 5.208]


def test_azimuth_offsets_point_to_the_left() -> None:
    aside = BeamPattern("aside", np.zeros(2), np.radians([0.0, 90.0]))
    np.testing.assert_allclose(aside.directions(4).reshape(2, 4, 3)[1, 0], [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("azimuth", [[0.0], [0.0, np.inf], [0.0, 4.0], [[0.0, 0.0]]])
def test_bad_azimuths_are_refused(azimuth: list[object]) -> None:
    with pytest.raises(InvalidValueError, match="azimuth_rad"):
        BeamPattern("mine", np.zeros(2), azimuth)  # type: ignore[arg-type]


def test_directions_are_unit_beam_by_beam_and_counter_clockwise() -> None:
    pattern = BeamPattern("two", np.radians([10.0, -20.0]))
    directions = pattern.directions(4).reshape(2, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    np.testing.assert_allclose(np.arcsin(directions[..., 2]), np.repeat(np.radians([[10.0], [-20.0]]), 4, axis=1))
    azimuth = np.arctan2(directions[..., 1], directions[..., 0]) % (2 * np.pi)
    np.testing.assert_allclose(azimuth[1], np.arange(4) * np.pi / 2, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "close"), [("HDL-32", "HDL-32E"), ("vlp-16", "Accepted: HDL-32E, HDL-64E, OS1-128, Pandar64, VLP-16")]
)
def test_unknown_names_list_the_known(name: str, close: str) -> None:
    with pytest.raises(UnknownNameError, match=close):
        PATTERNS.get(name)


@pytest.mark.parametrize("elevation", [[], [np.nan], [np.pi / 2], [[0.1, 0.2]], ["up"]])
def test_bad_tables_are_refused(elevation: list[object]) -> None:
    with pytest.raises(InvalidValueError, match="elevation_rad"):
        BeamPattern("mine", elevation)  # type: ignore[arg-type]
