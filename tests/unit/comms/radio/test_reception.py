"""Messages are received as the published curves say, and messages in one slot disturb each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.radio.obstruction import Obstruction, RadioScene
from coopsim.comms.radio.radio_config import ERROR_CURVES, Radio
from coopsim.comms.radio.reception import RadioReception
from coopsim.geometry.boxes import Boxes3D

CALM = np.zeros(2)

PUBLISHED = [  # scene, sight, scheme, SNR dB, block error rate: points of WiLabV2Xsim's tables of 350 bytes
    ("urban", "LOS", 4, -2.0, 0.8278),
    ("urban", "LOS", 4, 1.0, 0.0782),
    ("urban", "LOS", 7, 2.5, 0.5830),
    ("urban", "LOS", 11, 7.0, 0.2866),
    ("urban", "NLOS", 4, 1.0, 0.5588),
    ("urban", "NLOS", 7, 6.5, 0.1556),
    ("urban", "NLOS", 11, 11.0, 0.0568),
    ("highway", "LOS", 4, -2.5, 0.7710),
    ("highway", "LOS", 7, 2.0, 0.5016),
    ("highway", "LOS", 11, 8.0, 0.0586),
    ("highway", "NLOS", 4, 3.0, 0.1472),
    ("highway", "NLOS", 7, 5.0, 0.7244),
    ("highway", "NLOS", 11, 9.0, 0.5066),
]


def apart(*distances_m: float) -> RadioScene:
    """Agents a, b, ... along a street, in the open."""
    return RadioScene({name: np.array([x, 0.0, 1.6]) for name, x in zip("abcdef", distances_m, strict=False)})


@pytest.mark.parametrize(("scene", "state", "mcs", "snr_db", "error"), PUBLISHED)
def test_blocks_are_received_as_published(scene: str, state: str, mcs: int, snr_db: float, error: float) -> None:
    curve = Radio(scene, mcs=mcs).curve(Obstruction(state, 0))  # type: ignore[arg-type]
    assert 1 - curve.delivery(np.array(snr_db)) == pytest.approx(error, abs=0.03)


def test_a_faster_scheme_and_a_blocked_sight_need_more_signal() -> None:
    for scene in ("urban", "highway"):
        free, blocked = ERROR_CURVES[scene, "free"], ERROR_CURVES[scene, "blocked"]
        assert free[4].half_db < free[7].half_db < free[11].half_db
        assert all(free[mcs].half_db < blocked[mcs].half_db for mcs in free)


def test_a_modem_of_ones_own() -> None:
    radio = Radio(snr_half_db=3.0, snr_spread_db=2.0)
    for state in ("LOS", "NLOS"):
        curve = radio.curve(Obstruction(state, 0))  # type: ignore[arg-type]
        np.testing.assert_allclose(curve.delivery(np.array([3.0, 5.0])), [0.5, 0.8413], atol=1e-4)


@given(near=st.floats(1, 1500), farther=st.floats(0, 500), size=st.integers(1, 20_000), more=st.integers(0, 20_000))
def test_chances_fall_with_distance_and_size(near: float, farther: float, size: int, more: int) -> None:
    def chance(distance_m: float, size_bytes: int) -> float:
        return RadioReception(Radio(), 0).reception_probabilities({"a": size_bytes}, apart(0, distance_m))["a", "b"]

    assert 0 <= chance(near + farther, size) <= chance(near, size) <= 1
    assert chance(near, size + more) <= chance(near, size)


def test_all_blocks_of_a_message_must_be_received() -> None:
    air = [
        RadioReception(Radio(power_dbm=-20.0), 3).reception_probabilities({"a": size}, apart(0, 60))["a", "b"]
        for size in (350, 351, 1050)
    ]
    assert 0.1 < air[0] < 0.9
    np.testing.assert_allclose(air, [air[0], air[0] ** 2, air[0] ** 3])


def test_nobody_hears_while_sending_in_the_same_slot() -> None:
    one = RadioReception(Radio(slots=1), 0)
    assert one.reception_probabilities({"a": 100, "b": 100}, apart(0, 20)) == {("a", "b"): 0.0, ("b", "a"): 0.0}
    assert one.reception_probabilities({"a": 100}, apart(0, 20))["a", "b"] == pytest.approx(1.0)


def test_half_duplex_loses_as_often_as_two_slots_are_the_same() -> None:
    """As Gonzalez-Martin et al. 2019 have it: 1 in 100 for ten messages a second in slots of a millisecond."""
    air = RadioReception(Radio(slots=20), 0)
    lost = np.mean(
        [air.reception_probabilities({"a": 100, "b": 100}, apart(0, 20))["a", "b"] == 0 for _ in range(2000)]
    )
    assert lost == pytest.approx(1 / 20, abs=0.015)


def test_of_two_in_one_slot_the_nearer_is_heard_the_other_not() -> None:
    air = RadioReception(Radio(slots=1, power_dbm=23.0), 0)
    chances = air.reception_probabilities({"a": 100, "c": 100}, apart(0, 10, 200))
    assert chances["a", "b"] > 0.99 and chances["c", "b"] < 0.01
    assert air.reception_probabilities({"c": 100}, apart(0, 10, 200))["c", "b"] > 0.99


def test_interference_is_signal_over_noise_and_the_others_power() -> None:
    """Against the formula, worked out here for agents in the open without shadowing."""

    class Calm(RadioReception):
        def _received(self, first: str, second: str, around: RadioScene) -> tuple[float, Obstruction]:
            distance_m = abs(around.antennas[first][0] - around.antennas[second][0])
            return self._radio.received_dbm(distance_m, Obstruction(), CALM), Obstruction()

    radio = Radio(slots=1)
    chances = Calm(radio, 0).reception_probabilities({"a": 350, "c": 700, "d": 10}, apart(0, 50, 110, 140))
    milliwatts = [10 ** (radio.received_dbm(d, Obstruction(), CALM) / 10) for d in (50, 60, 90)]
    snr_db = 10 * np.log10(milliwatts[0] / (10 ** (radio.noise_dbm / 10) + milliwatts[1] + milliwatts[2]))
    wanted = radio.curve(Obstruction()).delivery(snr_db)
    assert chances["a", "b"] == pytest.approx(wanted) and 1e-3 < wanted < 0.999


@given(seed=st.integers(0, 1000), slots=st.integers(1, 30))
def test_slots_only_lose(seed: int, slots: int) -> None:
    around, sizes = apart(0, 40, 90, 150), {"a": 2000, "b": 300, "d": 9000}
    free, crowded = (
        RadioReception(Radio(), seed).reception_probabilities(sizes, around),
        RadioReception(Radio(slots=slots), seed).reception_probabilities(sizes, around),
    )
    assert set(free) == set(crowded)
    assert all(crowded[link] <= free[link] + 1e-9 for link in free)


def test_a_truck_costs_the_sight_and_its_curve() -> None:
    truck = Boxes3D.from_array(np.array([[30.0, 0.0, 1.9, 10.0, 2.5, 3.8, 0.0]]))
    free = apart(0, 60)
    blocked = RadioScene(free.antennas, {}, truck, np.array([1]))
    radio = Radio(power_dbm=-8.0)
    chances = [
        np.mean(
            [RadioReception(radio, seed).reception_probabilities({"a": 350}, around)["a", "b"] for seed in range(50)]
        )
        for around in (free, blocked)
    ]
    assert chances[0] > chances[1] + 0.3
