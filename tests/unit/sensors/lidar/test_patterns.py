"""Beam tables: the angles of data sheets and calibrations, and requirements on custom tables."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern


@pytest.mark.parametrize(
    ("name", "beams", "top_deg", "bottom_deg"),
    [
        ("VLP-16", 16, 15.0, -15.0),
        ("HDL-32E", 32, 10.67, -30.67),
        ("HDL-64E", 64, 1.96, -24.555),
        ("Pandar64", 64, 14.882, -24.897),
        ("OS1-128", 128, 20.47, -21.95),
    ],
)
def test_tables_span_what_their_sources_say(name: str, beams: int, top_deg: float, bottom_deg: float) -> None:
    elevation = np.degrees(PATTERNS.get(name).elevation_rad)
    assert len(elevation) == beams
    np.testing.assert_allclose([elevation.max(), elevation.min()], [top_deg, bottom_deg], atol=1e-9)


def test_the_hdl_32e_is_the_manuals_but_for_its_rounding() -> None:
    lower = [-30.67, -29.33, -28.0, -26.66, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67, -13.33]
    upper = [-12.0, -10.67, -9.33, -8.0, -6.66, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33, 6.67, 8.0, 9.33]
    manual_deg = [*lower, *upper, 10.67]
    np.testing.assert_allclose(np.degrees(PATTERNS.get("HDL-32E").elevation_rad), manual_deg[::-1], atol=0.01)


def test_hdl_64e_has_two_blocks_as_its_manual_says() -> None:
    elevation = np.degrees(PATTERNS.get("HDL-64E").elevation_rad)
    for block, step in ((elevation[:32], 1 / 3), (elevation[32:], 1 / 2)):
        assert -np.diff(block).mean() == pytest.approx(step, rel=0.03)
        assert -np.diff(block).min() > step / 2 and -np.diff(block).max() < 2 * step


def test_hdl_64e_points_where_its_driver_puts_the_points() -> None:
    """The first four lasers of the calibration file, radians, through the formula of the ROS driver's rawdata.cpp."""
    vertical = np.array([-0.1261818455292898, -0.11953745909742221, 0.00356118725906175, 0.010306535403103584])
    correction = np.array([-0.07648247457737148, -0.03932070772308096, 0.06005350008746038, 0.09919490315516696])
    columns = 8
    rotation = -np.arange(columns)[:, None] * 2 * np.pi / columns  # the driver's angles are clockwise
    aside, ahead = np.sin(rotation - correction), np.cos(rotation - correction)
    want = np.stack([ahead * np.cos(vertical), -aside * np.cos(vertical), np.sin(vertical) + 0 * ahead], axis=-1)
    directions = PATTERNS.get("HDL-64E").directions(columns).reshape(64, columns, 3)
    for laser in range(4):
        assert np.abs(directions - want[:, laser]).max(axis=(1, 2)).min() < 2e-5


def test_os1_128_points_where_its_sdk_puts_the_points() -> None:
    """The first and the last two beams of the metadata, degrees, through the formula of the SDK's make_xyz_lut."""
    altitude, azimuth = np.radians([20.47, 20.21, -21.68, -21.95]), np.radians([4.2, 1.42, -1.44, -4.25])
    columns = 1024
    encoder = 2 * np.pi * (1 - np.arange(columns) / columns)
    around = encoder - azimuth[:, None]
    flat = np.cos(altitude)[:, None]
    want = np.stack([np.cos(around) * flat, np.sin(around) * flat, np.sin(altitude)[:, None] + 0 * around], axis=-1)
    got = PATTERNS.get("OS1-128").directions(columns).reshape(128, columns, 3)[[0, 1, -2, -1]]
    backwards = -np.arange(columns) % columns  # the sensor turns clockwise
    np.testing.assert_allclose(got[:, backwards], want, atol=1e-12)


def test_os1_128_has_four_columns_that_are_8_firings_apart() -> None:
    unit = PATTERNS.get("OS1-128")
    columns = np.degrees(unit.offset_rad).reshape(32, 4)
    np.testing.assert_allclose(np.diff(columns, axis=1), 8 * 360 / 1024, atol=0.05)
    assert (-np.diff(np.degrees(unit.elevation_rad)) > 0.25).all()


def test_pandar64_is_finest_around_the_horizon_and_points_aside() -> None:
    pandar = PATTERNS.get("Pandar64")
    step = -np.diff(np.degrees(pandar.elevation_rad))
    assert step.min() > 0.15 and step.max() > 6.0
    np.testing.assert_allclose(step[5:53], 1 / 6, atol=0.01)
    np.testing.assert_allclose(step[53:61], 1.0, atol=0.05)
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
    ("name", "close"),
    [
        ("HDL-32", "HDL-32E"),
        ("vlp-16", "Accepted: 2x VLP-32C, HDL-32E, HDL-64E, OS1-128, Pandar64, VLP-16, VLP-32C"),
    ],
)
def test_unknown_names_list_the_known(name: str, close: str) -> None:
    with pytest.raises(UnknownNameError, match=close):
        PATTERNS.get(name)


@pytest.mark.parametrize("elevation", [[], [np.nan], [np.pi / 2], [[0.1, 0.2]], ["up"]])
def test_bad_tables_are_refused(elevation: list[object]) -> None:
    with pytest.raises(InvalidValueError, match="elevation_rad"):
        BeamPattern("mine", elevation)  # type: ignore[arg-type]
