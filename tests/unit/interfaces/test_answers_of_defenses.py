"""Answers of users' defences are checked before anything uses them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from coopsim.errors import DefenseError
from coopsim.interfaces.defense import Trust
from coopsim.interfaces.guard import checked_trust

RECEPTION: Any = SimpleNamespace(
    spec=SimpleNamespace(name="cav_0"),
    claims=[SimpleNamespace(detections=range(2)), SimpleNamespace(detections=range(1))],
)
SENDERS = {"cav_1": 0.5, "rsu_0": 1.0}


@pytest.mark.parametrize(
    "objects", [None, [np.array([0.0, 1.0]), np.array([0.5])], [np.array([0.25, 0.75]), np.array([1.0])]]
)
def test_trust_between_0_and_1_is_taken(objects: Any) -> None:
    trust = Trust(SENDERS, objects)
    assert checked_trust(trust, RECEPTION) is trust


@pytest.mark.parametrize(
    ("trust", "match"),
    [
        ({"cav_1": 0.5}, "must answer Trust, got dict for cav_0"),
        (Trust({"cav_1": 1.5}), r"trust in senders must be in \[0, 1\]"),
        (Trust({"cav_1": float("nan")}), r"trust in senders must be in \[0, 1\]"),
        (Trust(SENDERS, [np.zeros(2)]), r"of lengths \[2, 1\], for cav_0"),
        (Trust(SENDERS, [np.zeros(2), np.zeros(2)]), r"of lengths \[2, 1\], for cav_0"),
        (Trust(SENDERS, [np.array([0.0, 1.1]), np.zeros(1)]), r"trust in objects must be in \[0, 1\]"),
        (Trust(SENDERS, [np.zeros(2), np.array([-0.1])]), r"trust in objects must be in \[0, 1\]"),
    ],
)
def test_any_other_answer_is_refused(trust: Any, match: str) -> None:
    with pytest.raises(DefenseError, match=match):
        checked_trust(trust, RECEPTION)
