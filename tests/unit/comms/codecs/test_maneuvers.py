"""Planned ways and warnings of hard brakes come back within the standards' units, bit by bit as others write them."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from damaged_bytes import refusals
from unaligned_bits import bits

from coopsim.comms.codecs import maneuvers
from coopsim.comms.codecs.maneuvers import decode_denm, decode_mcm, encode_denm, encode_mcm, latest_ns
from coopsim.errors import CodecError, MissingDependencyError
from coopsim.types.intents import HardBrake, PlannedPath

pytest.importorskip("asn1tools")

MS = 10**6
PLACE = np.array([111.31949, -222.63898, 1.5])  # 1e-3 degrees to the east, 2e-3 to the south
POINTS, HEADINGS, SPEEDS = np.array([[0.0, 0.0], [3.0, -0.5]]), np.array([0.0, -0.1]), np.array([15.0, 14.25])
PATH = PlannedPath(4711, 1_500 * MS, PLACE, POINTS, HEADINGS, SPEEDS, 0.0, 0.2, 4.5, 1.9)
BRAKE = HardBrake(4711, 7, 1_000 * MS, 1_500 * MS, PLACE, np.pi / 2, 12.34)

# Made by pycrate 0.8.1 of the public module and of its own of EN 302 637-3, with parts that coopsim does not write.
FOREIGN_MCM = bytes.fromhex(
    "021400001267fde80435a49ae06b49f910032028384187362440fa2a33c600193e409ff9c800003e8a8c7fa8a000a0fa2af9fda880078384e0f0"
)
FOREIGN_DENM = bytes.fromhex(
    "020100001267c6000001978003800000007d000000002ee35a49ae06b49f9100320283841873624842663010d80389a44dc20e90700023fff2c6"
    "70002600"
)
WITH_A_ROUTE = bytes.fromhex(
    "021400001267fde80435a49ae06b49f910032028384187362640fa2a33c600193e409ff9c800003e8a8c7fa8a000a0fa2af9fda880078384e0f0"
    "0800060002"
)
AT = [(900_000_000 - 20_000, 31), (1_800_000_000 + 10_000, 32), (4095, 12), (4095, 12), (3601, 12)]
HEIGHT = [(100_000 + 150, 20), (15, 4)]  # 1.5 m, accuracy unavailable


def test_the_bits_of_a_planned_way_are_those_that_unaligned_per_gives() -> None:
    """Two points, worked out by hand: X.691 writes an integer in a range as its distance from the range's start."""
    assert encode_mcm(PATH) == bits(
        *[(2, 8), (20, 8), (4711, 32)],
        (1500, 16),
        *[(0, 1), (5, 8), *AT, *HEIGHT],  # no extension; a passenger car
        (0, 1),  # a road user
        *[(1, 1), (0, 1), (0, 1)],  # a planned way; no route, no advice
        *[(0, 1), (1, 3), (1500, 14), (900, 12), (45 - 1, 6), (19 - 1, 6)],  # automated; to the east, 4.5 m by 1.9 m
        *[(0, 16), (200 - 1, 8), (0, 1), (2 - 1, 7)],  # from now on, every 0.2 s; two points
        *[(131_072, 18), (131_072, 18), (1500, 14), (900, 12)],
        *[(131_072 + 300, 18), (131_072 - 50, 18), (1425, 14), (957, 12)],  # 5.7 degrees to the right
    )


def test_the_bits_of_a_hard_brake_are_those_that_unaligned_per_gives() -> None:
    assert encode_denm(BRAKE) == bits(
        *[(2, 8), (1, 8), (4711, 32)],
        *[(1, 1), (1, 1), (0, 1)],  # situation and place, nothing else
        (0, 1),  # no extension of the management
        *[(0, 1), (0, 1), (0, 1), (1, 1), (1, 1)],  # of five parts the duration and the interval
        *[(4711, 32), (7, 16), (1000, 42), (1500, 42), *AT, *HEIGHT],
        *[(2, 17), (100 - 1, 14), (5, 8)],  # for 2 s, every 100 ms; a passenger car
        *[(0, 1), (0, 1), (0, 1), (0, 3), (0, 1), (99, 8), (1, 8)],  # dangerous: emergency electronic brake
        *[(0, 1), (1, 1), (1, 1), (0, 1)],  # speed and heading, no kind of road
        *[(1234, 14), (127 - 1, 7), (0, 12), (127 - 1, 7)],  # to the north
        *[(1 - 1, 3), (0, 6)],  # one trace, of no points
    )


def test_what_is_in_range_comes_back() -> None:
    rng = np.random.default_rng(3)
    for count in (1, 20, 128):
        points, heading, speed = (
            rng.uniform(-1310, 1310, (count, 2)),
            rng.uniform(-3, 3, count),
            rng.uniform(0, 163.8, count),
        )
        sent = PlannedPath(
            2**32 - 1, 65_535 * MS, np.array([9e6, -9e6, -999.0]), points, heading, speed, 65.535, 0.255, 6.0, 0.1
        )
        got = decode_mcm(encode_mcm(sent))
        assert np.abs(got.points - points).max() <= 0.005 + 1e-9 and np.abs(got.position - sent.position).max() < 0.006
        assert np.abs(got.heading_rad - heading).max() <= np.radians(0.05) + 1e-9
        assert np.abs(got.speed_m_s - speed).max() <= 0.005 + 1e-9
        for name in ("station", "time_ns", "first_s", "step_s", "length_m", "width_m"):
            assert getattr(got, name) == getattr(sent, name)
    last = replace(BRAKE, station=0, number=65_535, began_ns=0, time_ns=(2**42 - 1) * MS, heading_rad=-np.pi / 2)
    got_brake = decode_denm(encode_denm(replace(last, speed_m_s=163.81)))
    assert (got_brake.number, got_brake.began_ns, got_brake.time_ns) == (65_535, 0, last.time_ns)
    assert got_brake.heading_rad == pytest.approx(-np.pi / 2) and got_brake.speed_m_s == 163.81


def test_long_vehicles_are_out_of_range_and_times_begin_anew() -> None:
    got = decode_mcm(encode_mcm(replace(PATH, length_m=12.0, width_m=np.nan, time_ns=70_000 * MS)))
    assert np.isnan(got.length_m) and np.isnan(got.width_m) and got.time_ns == (70_000 - 65_536) * MS
    assert latest_ns(got, 70_300 * MS) == 70_000 * MS and latest_ns(got, 69_999 * MS) == (70_000 - 65_536) * MS


def test_what_others_write_is_read() -> None:
    path = decode_mcm(FOREIGN_MCM)
    assert (path.station, path.time_ns, path.first_s, path.step_s) == (4711, 65_000 * MS, 0.1, 0.25)
    assert path.points.tolist() == [[-1.0, 0.0], [-3.5, 0.1], [-6.0, 0.3]] and path.speed_m_s.tolist() == [10, 10, 9]
    np.testing.assert_allclose(np.degrees(path.heading_rad), [-180.0, 175.0, 90.1])
    np.testing.assert_allclose(path.position, PLACE)
    assert np.isnan(path.length_m) and path.width_m == 2.5
    brake = decode_denm(FOREIGN_DENM)
    assert (brake.station, brake.number, brake.began_ns, brake.time_ns) == (815, 7, 1_000 * MS, 1_500 * MS)
    assert (brake.speed_m_s, brake.heading_rad) == (12.34, pytest.approx(-np.pi / 2))


@pytest.mark.parametrize(("decode", "whole"), [(decode_mcm, FOREIGN_MCM), (decode_denm, FOREIGN_DENM)])
def test_damaged_bytes_are_refused_or_read_never_worse(decode: Any, whole: bytes) -> None:
    refused = refusals(decode, whole, 3)
    assert len(refused) > 5 and not any("\n" in each for each in refused)
    for other in (whole + b"\0", bytes(40_000)):
        with pytest.raises(CodecError, match=r"are not what coopsim reads|at most 32768 bytes"):
            decode(other)


def raw(name: str, kind: int, changes: dict[str, Any], *to: Any) -> bytes:
    """A message by coopsim in which a part, found by its keys, is changed."""
    body, payload = {"MCM": ("mcm", encode_mcm(PATH)), "DENM": ("denm", encode_denm(BRAKE))}[name]
    content = maneuvers.decode_message(maneuvers._module(), name, kind, payload)[body]
    part = content
    for key in to:
        part = part[key]
    part |= changes
    return maneuvers.encode_message(maneuvers._module(), name, (kind, 1), body, content)


WAY = ("mcmParameters", "maneuverContainer", 1, "plannedTrajectory", "trajectoryPointContainer", 1)


@pytest.mark.parametrize(
    ("changes", "to", "match"),
    [
        ({"speed": 16_383}, WAY, "must have places, speeds and headings in range"),
        ({"heading": 3601}, WAY, "must have places, speeds and headings in range"),
        ({"xDistance": -131_072}, (*WAY, "waypoint"), "must have places, speeds and headings in range"),
        ({"latitude": 900_000_001}, ("mcmParameters", "basicContainer", "referencePosition"), "must be on earth"),
    ],
)
def test_ways_without_places_are_refused(changes: dict[str, Any], to: tuple[Any, ...], match: str) -> None:
    with pytest.raises(CodecError, match=match):
        decode_mcm(raw("MCM", 20, changes, *to))


def test_other_messages_and_parts_that_are_not_read_are_refused() -> None:
    with pytest.raises(CodecError, match=r"are not what coopsim reads of a MCM|which coopsim does not read"):
        decode_mcm(WITH_A_ROUTE)
    with pytest.raises(CodecError, match="a MCM has protocol 2 and id 20, got"):
        decode_mcm(b"\1" + FOREIGN_MCM[1:])
    event = {"eventType": {"causeCode": 2, "subCauseCode": 0}}
    for changes, to in ((event, "situation"), ({"termination": "isNegation"}, "management")):
        with pytest.raises(CodecError, match="a DENM must warn of a hard brake"):
            decode_denm(raw("DENM", 1, changes, to))
    with pytest.raises(CodecError, match="must have eventSpeed and eventPositionHeading in range"):
        decode_denm(raw("DENM", 1, {"eventSpeed": {"speedValue": 16_383, "speedConfidence": 127}}, "location"))
    with pytest.raises(CodecError, match="DENM"):
        decode_denm(FOREIGN_MCM)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"station": 2**32}, "stationID: Expected an integer between 0 and 4294967295"),
        (
            {"points": np.array([[0.0, 0.0], [1311.0, 0.0]])},
            "xDistance: Expected an integer between -131072 and 131071",
        ),
        ({"points": np.array([[0.0, 0.0], [np.nan, 0.0]])}, "must be finite"),
        ({"speed_m_s": np.array([0.0, 163.82])}, r"speeds must be in \[0, 163.81\] m/s"),
        ({"speed_m_s": np.array([0.0, -0.1])}, r"speeds must be in \[0, 163.81\] m/s"),
        ({"position": np.array([0.0, 1.1e7, 0.0])}, "a station must be on earth"),
        ({"step_s": 0.256}, "deltaTime: Expected an integer between 1 and 255"),
        ({"first_s": -0.1}, "startDeltaTime: Expected an integer between 0 and 65535"),
    ],
)
def test_ways_out_of_range_are_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(CodecError, match=match):
        encode_mcm(replace(PATH, **changes))


def test_no_points_and_too_many_are_refused() -> None:
    def path(count: int) -> PlannedPath:
        return replace(PATH, points=np.zeros((count, 2)), heading_rad=np.zeros(count), speed_m_s=np.zeros(count))

    with pytest.raises(CodecError, match="must have 1 to 128 points, got 0"):
        encode_mcm(path(0))
    with pytest.raises(CodecError, match="must have 1 to 128 points, got 129"):
        encode_mcm(path(129))


def test_brakes_out_of_range_are_refused() -> None:
    for changes, match in (
        ({"number": 65_536}, "sequenceNumber"),
        ({"began_ns": -MS}, "detectionTime"),
        ({"speed_m_s": np.inf}, "finite"),
    ):
        with pytest.raises(CodecError, match=match):
            encode_denm(replace(BRAKE, **changes))


def test_without_asn1tools_what_to_install_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    maneuvers._module.cache_clear()
    monkeypatch.setitem(sys.modules, "asn1tools", None)
    try:
        with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[etsi\]'"):
            maneuvers.require_maneuvers()
    finally:
        maneuvers._module.cache_clear()
