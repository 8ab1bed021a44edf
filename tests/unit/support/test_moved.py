"""Old names of modules work for one release, and warn."""

from __future__ import annotations

import importlib

import pytest


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("coopsim.attacks.attack", "coopsim.interfaces.attack", "Attack"),
        ("coopsim.defenses.defense", "coopsim.interfaces.defense", "Defense"),
        ("coopsim.planning.planner", "coopsim.interfaces.planner", "Planner"),
        ("coopsim.data.opencood", "coopsim.learn.opencood", "Layout"),
        ("coopsim.agents.late_fusion", "coopsim.agents.boxes", "LateFusion"),
        ("coopsim.world.towns.options", "coopsim.world.drawn_options", "TownOptions"),
        ("coopsim.data.recordings.find_format", "coopsim.recordings.formats", "open_folder"),
    ],
)
def test_an_old_module_gives_the_names_of_the_new_one_and_warns(old: str, new: str, name: str) -> None:
    module = importlib.import_module(old)
    with pytest.warns(DeprecationWarning, match=f"{old} is now {new}"):
        assert getattr(module, name) is getattr(importlib.import_module(new), name)
