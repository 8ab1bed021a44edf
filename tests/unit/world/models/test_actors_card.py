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
    rows = re.findall(r"^\| (\w+) \| (\w+) \| `(\w+)` \| (.*) \| (\d+) \| (\d+) \|$", CARD, flags=re.M)
    expected = [
        (
            ObjectClass(model.label).title,
            ObjectClass(model.label).superclass.title,
            model.name,
            " x ".join(f"{side:.2f}" for side in model.size_m),
            str(len(model.faces)),
            str(len(model.poses)),
        )
        for model in make_models()
    ]
    assert rows == expected


def test_every_variant_is_named_and_the_sizes_are_as_they_are_drawn() -> None:
    models = make_models(varied=True)
    lists = re.findall(r"^- \*\*(\w+)\*\*: ((?:`\w+`[,.]\s+)+)", CARD, flags=re.M)
    names = {title: re.findall(r"`(\w+)`", text) for title, text in lists}
    for cls in ObjectClass:
        plain = [model.name for model in make_models()]
        expected = [model.name for model in models if model.label == cls and model.name not in plain]
        assert names[cls.title] == expected
        moving = [model for model in models if model.label == cls and not model.stands]
        share, size = np.array([model.share for model in moving]), np.array([model.size_m for model in moving])
        mean = np.average(size, axis=0, weights=share)
        spread = np.sqrt(np.average((size - mean) ** 2, axis=0, weights=share))
        row = " | ".join(f"{one:.2f} ± {other:.2f}" for one, other in zip(mean, spread, strict=True))
        assert f"| {cls.title} | {row} |" in CARD


def test_the_range_of_triangles_is_as_said() -> None:
    counts = [len(model.faces) for model in make_models()]
    assert f"the plain models have {min(counts)} to {max(counts)}" in CARD


def test_the_users_model_of_the_card_is_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "CUSTOM_MODELS", Registry("model"))
    (program,) = re.findall(r"```python\n(.*?)```", CARD, flags=re.S)
    exec(program, {})
    assert make_models()[-1].name == "delivery_robot"
