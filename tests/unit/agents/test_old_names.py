"""Modules of policies under their old names."""

import importlib

import pytest

from coopsim.agents import boxes


@pytest.mark.parametrize(("old", "name"), [("late_fusion", "LateFusion"), ("ab3dmot_policy", "AB3DMOTTracking")])
def test_an_old_name_works_and_warns(old: str, name: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"coopsim\.agents\.{old} is now coopsim\.agents\.boxes"):
        assert getattr(importlib.import_module(f"coopsim.agents.{old}"), name) is getattr(boxes, name)
