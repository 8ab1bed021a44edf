"""The card of the actors says what they are, and what it tells users to type works."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from coopsim.support.registry import Registry
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import catalogue, make_models

CARD = (Path(__file__).parents[4] / "docs" / "reference" / "actors.md").read_text()


def test_the_table_has_every_model_as_it_is() -> None:
    rows = re.findall(r"^\| (\w+) \| (\w+) \| ((?:`\w+`(?:, )?)+) \| (.*) to (.*) \|$", CARD, flags=re.M)
    found = [(label, above, tuple(re.findall(r"`(\w+)`", names)), low, high) for label, above, names, low, high in rows]
    expected = []
    for cls in ObjectClass:
        models = [model for model in make_models() if model.label == cls]
        lengths = [f"{bound(model.size_m[0] for model in models):.2f}" for bound in (min, max)]
        expected.append((cls.title, cls.superclass.title, tuple(model.name for model in models), *lengths))
    assert sorted(found) == sorted(expected)


def test_the_sizes_of_variants_are_as_they_are_drawn() -> None:
    models = make_models(varied=True)
    for cls in ObjectClass:
        moving = [model for model in models if model.label == cls and not model.stands]
        share, size = np.array([model.share for model in moving]), np.array([model.size_m for model in moving])
        mean = np.average(size, axis=0, weights=share)
        spread = np.sqrt(np.average((size - mean) ** 2, axis=0, weights=share))
        length, _, height = (f"{one:.2f} ± {other:.2f}" for one, other in zip(mean, spread, strict=True))
        assert f"| {cls.title} | {length} | {height} |" in CARD


def test_the_range_of_triangles_is_as_said() -> None:
    counts = [len(model.faces) for model in make_models()]
    assert f"the plain models have {min(counts)} to {max(counts)}" in CARD


def test_the_users_model_of_the_card_is_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "CUSTOM_MODELS", Registry("model"))
    (program,) = re.findall(r"```python\n(.*?)```", CARD, flags=re.S)
    exec(program, {})
    assert make_models()[-1].name == "delivery_robot"
