"""What a policy says of itself is checked where the cell runs, and ends no other cell."""

from __future__ import annotations

from pathlib import Path

import pytest

from coopsim.bench.benchmark import benchmark
from coopsim.bench.grid.grid import Grid
from coopsim.bench.store.store import Store

_POLICY = """
import numpy as np
from coopsim.agents.boxes import NoFusion

class Odd(NoFusion):
    def __init__(self, said="np.sum(np.ones(3, dtype=bool))", method="''", raises=False):
        super().__init__()
        self.method, self._said, self._raises = eval(method), said, raises

    def track(self, agent, observation):
        if self._raises:
            raise OSError("no file " + chr(0xDC80))
        self.counts = eval(self._said)
        return super().track(agent, observation)
"""

_REFUSED = {
    "{'boxes': True}": "counts['boxes'] must be an integer in",
    "{'boxes': 'many'}": "counts['boxes'] must be an integer in",
    "{'boxes': 2**63}": "counts['boxes'] must be an integer in",
    "{'boxes': 0.5}": "counts['boxes'] must be an integer in",
    "{'boxes': np.float64(2)}": "counts['boxes'] must be an integer in",
    "{3: 1}": "counts must be by name, got 3",
    "[1, 2]": "TypeError",
}


@pytest.mark.usefixtures("jobs_here")
def test_a_policy_that_counts_oddly_fails_alone(tmp_path: Path) -> None:
    file = tmp_path / "odd.py"
    file.write_text(_POLICY)
    said = {text: f'{file}:Odd(said="{text}")' for text in ("{'boxes': np.sum(np.ones(3, bool))}", *_REFUSED)}
    others = [f"{file}:Odd(said='dict()', method='3')", f"{file}:Odd(raises=True)", "no_fusion"]
    grid = Grid((*said.values(), *others), frames=2, options={"lidar": None, "vehicles": 4})
    results = benchmark(grid, tmp_path / "out")
    good, *refused = results[: len(said)]
    assert good.counts == {"boxes": 3} and type(good.counts["boxes"]) is int
    for result, reason in zip(refused, _REFUSED.values(), strict=True):
        assert reason in str(result.reason)
    number, raising, plain = results[len(said) :]
    assert "method must be a text, got 3" in str(number.reason) and "OSError" in str(raising.reason)
    assert not plain.failed
    assert [each.traceback for each in Store(tmp_path / "out").results()] == [each.traceback for each in results]
