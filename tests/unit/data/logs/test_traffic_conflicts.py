"""Conflicts that the page of real traffic counts."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from coopsim.data.logs.reading import read_log

SCRIPTS = Path(__file__).parents[4] / "scripts"


def _row(time: int, name: str, x: float, y: float, heading: float) -> str:
    return f"{time / 10},{name},car,{x:.3f},{y:.3f},{heading},4.0,2.0"


@pytest.mark.parametrize(("late_m", "met"), [(20.0, True), (90.0, False)])
def test_only_those_who_cross_soon_after_each_other_are_in_conflict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late_m: float, met: bool
) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    find_conflicts = importlib.import_module("traffic_conflicts").find_conflicts
    rows = ["time_s,id,class,x_m,y_m,heading_rad,length_m,width_m"]
    for k in range(160):
        rows.append(_row(k, "east", k - 50.0, 0.0, 0.0))
        rows.append(_row(k, "follows", k - 62.0, 0.0, 0.0))
        rows.append(_row(k, "north", 0.0, k - 50.0 - late_m, np.pi / 2))
    (tmp_path / "a.csv").write_text("\n".join(rows))
    log = read_log(tmp_path / "a.csv")
    found = {tuple(log.ids[k] for k in each.pair): each for each in find_conflicts(log)}
    assert (("east", "north") in found) is met
    assert ("east", "follows") not in found
    if met:  # "east" covers the point (-1, -1) from -3 on, at 4.7 s, and leaves (1, 1) at 5.3 s
        conflict = found["east", "north"]
        assert conflict.time_s == pytest.approx(4.7)
        assert conflict.place == pytest.approx((-1.0, -1.0), abs=2.0)
        assert conflict.pet_s == pytest.approx(1.4, abs=0.2)
    sys.modules.pop("traffic_conflicts", None)
