from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.arrays import pack_points, round_points, unpack_points


def test_points_are_rounded_to_a_centimetre_once() -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-327, 327, (1000, 3)), rng.uniform(0, 1, 1000)]).astype(np.float32)
    rounded = round_points(points)
    assert rounded.dtype == np.float32
    assert np.abs(rounded[:, :3] - points[:, :3]).max() < 0.00502
    assert np.abs(rounded[:, 3] - points[:, 3]).max() < 0.00197
    assert (round_points(rounded) == rounded).all()
    assert (unpack_points(*pack_points(rounded)) == rounded).all()


@pytest.mark.parametrize("bad", [(328, 0, 0, 0), (0, 0, -400, 0), (np.nan, 0, 0, 0), (0, 0, 0, 1.5), (0, 0, 0, np.nan)])
def test_what_does_not_fit_is_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(InvalidValueError, match="327 m"):
        pack_points(np.array([bad], np.float32))
