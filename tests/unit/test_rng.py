"""Streams depend on their name and on nothing else."""

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.rng import stream


def test_same_name_same_bits() -> None:
    a, b = stream(7, "lidar", "cav_0").random(5), stream(7, "lidar", "cav_0").random(5)
    np.testing.assert_array_equal(a, b)


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
