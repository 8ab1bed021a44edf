"""Distance, vehicles and buildings cost what the tables say, and shadowing is one for both directions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon

from coopsim.comms.radio.obstruction import Obstruction, RadioScene
from coopsim.comms.radio.radio_config import Fading, Radio
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.world.snapshot import Actors, AgentBody

CALM = np.zeros(2)
BUILDING = np.array([[-10.0, 20.0], [10.0, 20.0], [10.0, 40.0], [-10.0, 40.0]])


def surroundings(rows: list[list[float]], positions: dict[str, tuple[float, float, float]]) -> RadioScene:
    count = len(rows)
    boxes = Boxes3D.from_array(np.array(rows).reshape(-1, 7))
    ids = np.arange(1, count + 1)
    zero = np.zeros(count, dtype=np.int64)
    actors = Actors(ids, boxes, np.zeros((count, 2)), zero, zero, np.zeros((count, 3), dtype=np.uint8))
    bodies = {
        name: AgentBody(name, "cav", 1 if name == "a" else None, SE3.from_xyz_yaw([x, y, 0], 0.3), height)
        for name, (x, y, height) in positions.items()
    }
    return RadioScene.of(bodies, actors, (BUILDING,))


def test_path_loss_is_that_of_the_tables() -> None:
    radio, highway = Radio(), Radio("highway")
    assert radio.path_loss_db(100.0, Obstruction()) == pytest.approx(38.77 + 33.4 + 18.2 * np.log10(5.9))
    assert radio.path_loss_db(100.0, Obstruction("NLOS", 0)) == pytest.approx(36.85 + 60 + 18.9 * np.log10(5.9))
    assert highway.path_loss_db(100.0, Obstruction()) == pytest.approx(32.4 + 40 + 20 * np.log10(5.9))
    assert radio.received_dbm(100.0, Obstruction(), CALM) == pytest.approx(
        29 - radio.path_loss_db(100.0, Obstruction())
    )
    assert radio.noise_dbm == pytest.approx(-174 + 70 + 9)


def test_vehicles_cost_less_the_more_antennas_are_above_them() -> None:
    heard = [Radio().received_dbm(100.0, Obstruction("NLOSv", above), CALM) for above in (0, 1, 2)]
    np.testing.assert_allclose(np.array(heard) - heard[2], [-9.0, -5.0, 0.0])
    far = Radio().received_dbm(1000.0, Obstruction("NLOSv", 0), CALM) - Radio().received_dbm(
        1000.0, Obstruction("LOS"), CALM
    )
    assert far == pytest.approx(-(9.0 + 15 * 3 - 41))


def test_shadowing_has_unit_variance_and_loses_1_over_e_over_its_distance() -> None:
    fading = Fading(np.random.default_rng(0))
    still = np.zeros(3)
    values = np.array([fading.at(np.stack([still, [2.0 * k, 0, 0]]), 10.0)[0] for k in range(40_000)])
    assert values.std() == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(values[:-5], values[5:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)
    again = fading.at(np.stack([still, [2.0 * 39_999, 0, 0]]), 10.0)[0]
    assert again == values[-1]  # nobody moved


def test_a_building_a_truck_and_its_height_are_told_apart() -> None:
    truck = [30.0, 0.0, 1.9, 10.0, 2.5, 3.8, 0.1]
    own = [0.0, 0.0, 0.8, 4.5, 1.9, 1.6, 0.0]
    scene = surroundings(
        [own, truck], {"a": (0, 0, 1.6), "b": (60, 1, 1.6), "mast": (61, 0, 6.0), "behind": (0, 60, 6)}
    )
    assert scene.between("a", "b") == Obstruction("NLOSv", 0) == scene.between("b", "a")
    assert scene.between("a", "mast") == Obstruction("NLOSv", 1)
    assert scene.between("a", "behind") == Obstruction("NLOS", 0)
    assert scene.between("b", "mast") == Obstruction("LOS", 2)


@settings(max_examples=60)
@given(
    box=st.tuples(st.floats(-30, 30), st.floats(-30, 15), st.floats(0.5, 12), st.floats(0.5, 4), st.floats(-3, 3)),
    ends=st.tuples(*[st.floats(-50, 50)] * 4),
)
def test_lines_of_sight_are_those_of_an_independent_implementation(
    box: tuple[float, ...], ends: tuple[float, ...]
) -> None:
    x, y, length, width, yaw = box
    rows = Boxes3D.from_array([[x, y, 1.0, length, width, 2.0, yaw]])
    line = LineString([ends[:2], ends[2:]])
    footprint = Polygon(rows.corners[0, :4, :2])
    if min(abs(line.distance(shape.boundary)) for shape in (footprint, Polygon(BUILDING))) < 1e-6 and (
        line.intersection(footprint).length < 1e-6 or line.intersection(Polygon(BUILDING)).length < 1e-6
    ):
        return  # a line that only touches may be called either
    antennas = {"p": np.array([*ends[:2], 1.5]), "q": np.array([*ends[2:], 1.5])}
    walls = np.stack([BUILDING, np.roll(BUILDING, -1, axis=0)], axis=1)
    state = RadioScene(antennas, {}, rows, np.array([1]), walls).between("p", "q").state
    if line.intersects(Polygon(BUILDING).boundary):
        assert state == "NLOS"
    else:
        assert state == ("NLOSv" if line.intersects(footprint) else "LOS")


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"scene": "rural"}, UnknownNameError, "unknown scene 'rural'"),
        ({"carrier_ghz": 0}, InvalidValueError, "carrier_ghz must be a finite number > 0, got 0"),
        ({"power_dbm": float("inf")}, InvalidValueError, "power_dbm must be a finite number"),
        ({"snr_spread_db": -1}, InvalidValueError, "snr_spread_db"),
        ({"snr_half_db": "5"}, InvalidValueError, "snr_half_db must be a finite number, got '5'"),
        ({"mcs": 5}, InvalidValueError, "mcs must be one of 4, 7, 11, got 5; set snr_half_db for another"),
        ({"mcs": True}, InvalidValueError, "mcs must be one of 4, 7, 11, got True"),
        ({"block_bytes": 0}, InvalidValueError, "block_bytes must be an integer >= 1, got 0"),
        ({"slots": 0}, InvalidValueError, r"slots must be an integer in 1\.\.10000, got 0"),
    ],
)
def test_bad_radio(options: dict, error: type[Exception], match: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(error, match=match):
        Radio(**options)
