"""Water darkens."""

import numpy as np
import pytest

from coopsim.world.relief.wet_albedo import wet_albedo


def test_a_film_of_water_darkens_by_angstroms_law() -> None:
    assert wet_albedo(np.array([0.3])) == pytest.approx(0.3 / (1.33**2 * 0.7 + 0.3))
    assert wet_albedo(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])
