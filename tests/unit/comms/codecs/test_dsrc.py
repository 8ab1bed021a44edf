"""SPATEM and MAPEM come back within the standards' units, and their bits are those that others write."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from damaged_bytes import refusals
from unaligned_bits import bits

from coopsim.comms.codecs import dsrc
from coopsim.comms.codecs.dsrc import decode_mapem, decode_spatem, encode_mapem, encode_spatem, require_dsrc
from coopsim.errors import CodecError, MissingDependencyError
from coopsim.types.intersections import HOUR_DS, UNKNOWN_MARK, IntersectionMap, MapLane, MovementPhase, SignalPhases

pytest.importorskip("asn1tools")

MARKS = np.array([[612, HOUR_DS, UNKNOWN_MARK], [700, 0, UNKNOWN_MARK]])
PHASES = SignalPhases(7, 61_250 * 10**6, np.array([1, 2, 255]), np.array([3, 6, 8]), *MARKS, 3)
APPROACH = MapLane(1, "vehicle", np.array([[0.0, 5.12], [0.0, 60.0]]), True, False, ((2, 1), (3, None)))
WALK = MapLane(9, "crosswalk", np.array([[-300.0, 5.0], [0.0, 200.0]]), True, True, ((9, 2),))
MAP = IntersectionMap(7, np.array([10.0, -20.0, 3.21]), (APPROACH, WALK), 3.5, 3)

# Made by pycrate's own modules of TS 103 301, with parts that coopsim reads and does not write.
FOREIGN_SPATEM = bytes.fromhex(
    "0204000030396186a01376fe5d3401c0329bc00c4308c283000c350752f80a032d8808a37d76d977dd796d7892d81f1200bc84004008"
)
FOREIGN_MAPEM = bytes.fromhex(
    "020500003039780c35003302060194de0062184615541dbb076b36fb7914d2028a02d8080412438000200000663ce0e15736201e0560d00002"
    "120070005600180000002017f8300dfe00"
)
WITH_ENABLED_LANES = bytes.fromhex("020400003039001c000080000000005000000300001001")


def test_the_bits_are_those_that_unaligned_per_gives() -> None:
    """One red light, worked out by hand: X.691 writes an integer in a range as its distance from the range's start."""
    one = SignalPhases(3107, 61_250 * 10**6, *np.array([[5], [MovementPhase.RED], [720], [725]]), 9)
    assert encode_spatem(4711, [one]) == bits(
        *[(2, 8), (4, 8), (4711, 32)],
        *[(0, 1), (0, 3)],  # no extension of SPAT; neither time, name nor regional parts
        (1 - 1, 5),  # one intersection
        *[(0, 1), (0, 1), (1, 1), (1, 1), (0, 3)],  # no name; minute and milliseconds; nothing else
        *[(0, 1), (3107, 16), (9, 7), (1 << 10, 16), (1, 20), (1250, 16)],  # no region; fixed times
        (1 - 1, 8),  # one group
        *[(0, 1), (0, 3), (5, 8), (1 - 1, 4)],
        *[(0, 1), (1, 1), (0, 2), (3, 4)],  # with times; stop and remain
        *[(0, 1), (0, 1), (1, 1), (0, 2), (720, 16), (725, 16)],  # the least and the likely time
    )


def test_phases_come_back_as_they_were() -> None:
    first, second = decode_spatem(
        encode_spatem(2**32 - 1, [PHASES, replace(PHASES, intersection=65_535, revision=127)])
    )
    assert (second.intersection, second.revision, first.intersection, first.revision) == (65_535, 127, 7, 3)
    assert first.time_ns == PHASES.time_ns
    for name in ("group", "phase", "earliest_ds", "likely_ds"):
        np.testing.assert_array_equal(getattr(first, name), getattr(PHASES, name))


def test_a_junction_comes_back_to_the_centimetre() -> None:
    (got,) = decode_mapem(encode_mapem(1, [MAP]))
    assert np.abs(got.reference - MAP.reference)[:2].max() < 0.006 and got.reference[2] == pytest.approx(3.2)
    assert (got.intersection, got.revision, got.lane_width_m) == (7, 3, 3.5)
    for lane, sent in zip(got.lanes, MAP.lanes, strict=True):
        assert np.abs(lane.points - sent.points).max() < 0.005 + 1e-9
        assert [getattr(lane, name) for name in ("id", "kind", "approaches", "leaves", "connections")] == [
            getattr(sent, name) for name in ("id", "kind", "approaches", "leaves", "connections")
        ]
    many = MapLane(1, "vehicle", np.cumsum(np.full((63, 2), 0.0149), axis=0), True, False)
    (rounded,) = decode_mapem(encode_mapem(1, [replace(MAP, lanes=(many,))]))
    assert np.abs(rounded.lanes[0].points - many.points).max() < 0.005 + 1e-9  # rounding does not add up


@pytest.mark.parametrize("size_m", [5.11, 5.12, 10.23, 20.47, 40.95, 81.91, 81.92, 327.67])
def test_offsets_of_every_width(size_m: float) -> None:
    points = np.array([[size_m, -size_m - 0.01]] * 2)
    (got,) = decode_mapem(encode_mapem(1, [replace(MAP, lanes=(replace(APPROACH, points=points),))]))
    np.testing.assert_allclose(got.lanes[0].points, points, atol=1e-9)


def test_what_others_write_is_read() -> None:
    (phases,) = decode_spatem(FOREIGN_SPATEM)
    assert (phases.intersection, phases.revision, phases.time_ns) == (3107, 5, (100_000 * 60_000 + 59_999) * 10**6)
    assert phases.group.tolist() == [1, 2]
    assert phases.phase.tolist() == [MovementPhase.GREEN, MovementPhase.RED_AND_YELLOW]
    assert phases.earliest_ds.tolist() == [24_055, UNKNOWN_MARK] and phases.likely_ds.tolist() == [24_100, UNKNOWN_MARK]
    (junction,) = decode_mapem(FOREIGN_MAPEM)
    lane, pavement = junction.lanes
    assert (junction.intersection, junction.lane_width_m, junction.reference[2]) == (3107, 3.25, 123.4)
    assert lane.connections == ((6, 1), (7, None)) and lane.approaches and not lane.leaves
    assert lane.points.tolist() == [[-25.0, 31.0], [-115.0, 32.2]]
    assert pavement.kind == "other" and pavement.approaches and pavement.leaves


@pytest.mark.parametrize(("decode", "whole"), [(decode_spatem, FOREIGN_SPATEM), (decode_mapem, FOREIGN_MAPEM)])
def test_damaged_bytes_are_refused_or_read_never_worse(decode: Any, whole: bytes) -> None:
    with pytest.raises(CodecError, match="are not what coopsim reads of a"):
        decode(whole + b"\0")
    refused = refusals(decode, whole, 5)
    assert len(refused) > 5 and not any("\n" in each for each in refused)
    with pytest.raises(CodecError, match="at most 32768 bytes, got 40000"):
        decode(bytes(40_000))


def test_parts_that_are_not_read_and_other_messages_are_refused() -> None:
    with pytest.raises(CodecError, match="are not what coopsim reads of a SPATEM"):
        decode_spatem(WITH_ENABLED_LANES)
    state = dsrc._state_of(PHASES) | {"enabledLanes": None}  # bits that happen to fit
    with pytest.raises(CodecError, match="the SPATEM has enabledLanes, which coopsim does not read"):
        decode_spatem(dsrc._encoded("SPATEM", 1, "spat", {"intersections": [state]}))
    with pytest.raises(CodecError, match="a SPATEM has protocol 2 and id 4, got"):
        decode_spatem(b"\1" + FOREIGN_SPATEM[1:])
    with pytest.raises(CodecError, match="MAPEM"):
        decode_mapem(FOREIGN_SPATEM)


def test_phases_without_their_time_are_refused() -> None:
    state = {key: value for key, value in dsrc._state_of(PHASES).items() if key != "moy"}
    with pytest.raises(CodecError, match="intersection 7 must have moy and timeStamp, got 527040 and 1250"):
        decode_spatem(dsrc._encoded("SPATEM", 1, "spat", {"intersections": [state]}))


def test_the_year_of_an_episode_begins_anew() -> None:
    year_ns = 366 * 24 * 3600 * 10**9
    (got,) = decode_spatem(encode_spatem(1, [replace(PHASES, time_ns=year_ns + 10**9)]))
    assert got.time_ns == 10**9


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"intersection": 65_536}, "an integer between 0 and 65535, but got 65536"),
        ({"revision": 128}, "revision: Expected an integer between 0 and 127"),
        ({"earliest_ds": [0, 0, 36_002]}, "minEndTime: Expected an integer between 0 and 36001"),
        ({"group": [1, 2, 256]}, "signalGroup: Expected an integer between 0 and 255"),
        ({"group": [1, 2, 2]}, "signal groups must be distinct numbers from 1 on"),
        ({"group": [0, 1, 2]}, "signal groups must be distinct numbers from 1 on"),
        ({"phase": [3, 6, 10]}, "a phase must be a MovementPhase, 0 to 9, got 10"),
    ],
)
def test_phases_out_of_range_are_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(CodecError, match=match):
        encode_spatem(1, [replace(PHASES, **changes)])


def test_as_many_groups_as_fit_and_no_more() -> None:
    def phases(count: int) -> SignalPhases:
        return SignalPhases(1, 0, np.arange(1, count + 1), *np.full((3, count), 5))

    (got,) = decode_spatem(encode_spatem(1, [phases(255)]))
    assert len(got.group) == 255
    for wrong in ([phases(256)], [phases(0)], [phases(1)] * 33, []):
        with pytest.raises(CodecError, match=r"Expected a list of between 1 and \d+ elements|between 0 and 255"):
            encode_spatem(1, wrong)
    with pytest.raises(CodecError, match="stationID"):
        encode_spatem(2**32, [phases(1)])


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"points": np.zeros((1, 2))}, "nodes: Expected a list of between 2 and 63 elements, but got 1"),
        ({"points": np.zeros((64, 2))}, "nodes: Expected a list of between 2 and 63 elements, but got 64"),
        (
            {"points": np.array([[0.0, 0.0], [328.0, 0.0]])},
            "points of a lane must be at most 327 m apart, got 328, 0 m",
        ),
        ({"points": np.array([[0.0, np.nan], [1.0, 0.0]])}, "must be finite"),
        ({"id": 256}, "laneID: Expected an integer between 0 and 255"),
        ({"kind": "other"}, "the kind of a lane must be one of vehicle, crosswalk to be written, got 'other'"),
        ({"connections": ((1, 1),) * 17}, "connectsTo: Expected a list of between 1 and 16 elements"),
        ({"connections": ((1, 256),)}, "signalGroup: Expected an integer between 0 and 255"),
    ],
)
def test_lanes_out_of_range_are_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(CodecError, match=match):
        encode_mapem(1, [replace(MAP, lanes=(replace(APPROACH, **changes),))])


def test_a_junction_must_be_on_earth() -> None:
    for far in ([0.0, 1.1e7, 0.0], [2.1e7, 0.0, 0.0], [0.0, 0.0, 7000.0]):
        with pytest.raises(CodecError, match="refPoint"):
            encode_mapem(1, [replace(MAP, reference=np.array(far))])


def test_without_asn1tools_what_to_install_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    dsrc._module.cache_clear()
    monkeypatch.setitem(sys.modules, "asn1tools", None)
    try:
        with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[etsi\]'"):
            require_dsrc()
    finally:
        dsrc._module.cache_clear()
