"""How worker processes end, in words."""

import pytest

from coopsim.support.processes import cause_of_end


@pytest.mark.parametrize(("status", "said"), [(0, "exit status 0"), (3, "exit status 3"), (-9, "SIGKILL"), (-35, "35")])
def test_every_signal_is_told(status: int, said: str) -> None:
    assert said in cause_of_end(status)
