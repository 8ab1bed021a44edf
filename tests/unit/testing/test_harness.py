"""The harness of checks notices each change of nested data."""

from dataclasses import dataclass

import numpy as np
import pytest

from coopsim.testing.harness import untouched


@dataclass
class Part:
    values: np.ndarray


@pytest.mark.parametrize("place", [0, 1500])
@pytest.mark.parametrize("nest", [list, tuple, lambda parts: {"inner": (parts,)}])
def test_a_change_in_a_long_array_of_nested_parts_is_noticed(nest: object, place: int) -> None:
    # A long array's text has only its ends.
    parts = [Part(np.zeros(3000)), Part(np.zeros(3000))]
    given = nest(parts) if callable(nest) else None
    with untouched(given, "must stay"):
        pass
    with pytest.raises(AssertionError, match="must stay"), untouched(given, "must stay"):
        parts[1].values[place] = 1.0


def test_a_part_more_or_less_is_noticed() -> None:
    given = [[1.0], [2.0]]
    with pytest.raises(AssertionError, match="must stay"), untouched(given, "must stay"):
        given[0].append(given[1].pop())
