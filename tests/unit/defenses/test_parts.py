"""Parts of defences by hand-made cases: patches of maps, adjusted p-values, ways of senders in a second."""

from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from coopsim.defenses.made import _patches, adjusted
from coopsim.defenses.plausibility import Plausibility
from coopsim.geometry.se3 import SE3
from coopsim.types import BevGrid, FeatureMap

GRID = BevGrid((0.0, 12.0), (0.0, 10.0), 1.0)


def test_patches_are_the_3_x_3_cells_around_each_inner_cell() -> None:
    values = np.arange(2 * 10 * 12, dtype=np.float32).reshape(2, 10, 12)
    patches = _patches(FeatureMap(values, GRID))
    assert patches is not None and patches.shape == (8 * 10, 2 * 9)
    np.testing.assert_array_equal(patches[0], values[:, :3, :3].reshape(-1))
    np.testing.assert_array_equal(patches[-1], values[:, -3:, -3:].reshape(-1))


def test_patches_with_a_cell_that_was_not_sent_are_left_out() -> None:
    values, sent = np.ones((1, 10, 12), np.float32), np.ones((10, 12), np.bool_)
    sent[0, 0] = False
    patches = _patches(FeatureMap(values, GRID, sent=sent))
    assert patches is not None and len(patches) == 79
    sent[:, 3:] = False
    assert _patches(FeatureMap(values, GRID, sent=sent)) is None


def test_p_values_are_adjusted_by_their_rank() -> None:
    assert adjusted([0.01]) == pytest.approx(0.01)
    assert adjusted([0.04, 0.02]) == pytest.approx(0.04)
    assert adjusted([0.9, 0.02]) == pytest.approx(0.04)
    assert adjusted([1.0, 1.0]) == 1.0


def heard(defense: Plausibility, at_s: float, x_m: float) -> bool:
    """Return whether a new message of a sender is possible, that states this place at this time."""
    time_ns = round(at_s * 1e9)
    claim: Any = SimpleNamespace(
        sender="cav_1", age_s=0.0, message=SimpleNamespace(captured_ns=time_ns),
        base_SE3_sender=SE3.from_xyz_yaw([x_m, 0.0, 0.0], 0.0),
    )  # fmt: skip
    reception: Any = SimpleNamespace(
        odom_SE3_base=SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.0), observation=SimpleNamespace(time_ns=time_ns)
    )
    return defense._sender_is_possible(claim, reception)


def test_a_sender_s_way_of_the_last_second_is_kept_and_judged() -> None:
    defense = Plausibility()
    defense._began_ns = 0
    assert all(heard(defense, 0.1 * k, 1.0 * k) for k in range(30))
    (path,) = defense._paths.values()
    assert isinstance(path, deque) and len(path) == 11  # 1.05 s at 10 Hz
    assert not heard(defense, 3.0, 150.0)


def test_more_messages_than_a_sender_may_send_are_not_possible() -> None:
    defense = Plausibility()
    defense._began_ns = 0
    good = [heard(defense, 0.01 * k, 0.1 * k) for k in range(60)]
    assert all(good[:25]) and not any(good[30:])
