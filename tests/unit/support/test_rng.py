"""Streams depend on their name and on nothing else."""

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.support.rng import _splitmix64, stream, uniform_numbers


def test_same_name_same_bits() -> None:
    one, other = stream(7, "lidar", "cav_0"), stream(7, "lidar", "cav_0")
    first = one.random(5)
    np.testing.assert_array_equal(other.random(5), first)  # whatever was drawn from the other
    assert len({*first, *one.random(5)}) == 10


@pytest.mark.parametrize(
    ("seed", "purpose", "who"),
    [
        (8, "lidar", ("cav_0",)),
        (7, "pose", ("cav_0",)),
        (7, "lidar", ("cav_1",)),
        (7, "lidar", ("cav_", "0")),
        (7, "lidarcav_0", ()),
    ],
)
def test_another_name_gives_other_bits(seed: int, purpose: str, who: tuple[str, ...]) -> None:
    assert not np.array_equal(stream(seed, purpose, *who).random(5), stream(7, "lidar", "cav_0").random(5))


def test_streams_of_neighbouring_agents_are_unrelated() -> None:
    draws = np.stack([stream(0, "pose", f"cav_{k}").standard_normal(2000) for k in range(8)])
    off_diagonal = np.corrcoef(draws)[~np.eye(8, dtype=bool)]
    assert np.abs(off_diagonal).max() < 0.1


@pytest.mark.parametrize("seed", [-1, 1.5, "7", None, True])
def test_bad_seed(seed: object) -> None:
    with pytest.raises(InvalidValueError, match="seed must be an integer >= 0"):
        stream(seed, "lidar")  # type: ignore[arg-type]


def test_splitmix64_gives_its_published_numbers() -> None:
    """The first five for the seed 1234567."""
    state = np.uint64(1234567) + np.arange(1, 6, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    assert _splitmix64(state).tolist() == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


def test_draws_are_uniform_and_of_the_owner_alone() -> None:
    who = np.arange(5000)
    draws = uniform_numbers(5, "paint", who, 3)
    assert draws.shape == (5000, 3) and (draws >= 0).all() and (draws < 1).all()
    np.testing.assert_allclose(draws.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(np.corrcoef(draws.T), np.eye(3), atol=0.05)
    assert np.abs(np.corrcoef(draws[1:, 0], draws[:-1, 0])[0, 1]) < 0.05
    np.testing.assert_array_equal(uniform_numbers(5, "paint", who[[70, 3]], 3), draws[[70, 3]])
    for other in (uniform_numbers(6, "paint", who, 3), uniform_numbers(5, "gait", who, 3)):
        assert (other != draws).all()
