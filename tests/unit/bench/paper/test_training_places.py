"""Places of a training are those of all that the weights were made from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from coopsim.bench.paper.provenance import TrainingPlaces, training_places


def card(folder: Path, name: str, first_place: int | None = None, **recipe: Any) -> str:
    """Write the card of weights; return their path."""
    path = folder / f"{name}.safetensors"
    world = {} if first_place is None else {"world": {"first_place": first_place, "places": 10}}
    path.with_suffix(".json").write_text(json.dumps({"recipe": {**recipe, **world}}))
    return str(path)


def test_places_of_the_beginning_the_detector_and_the_teacher_count(tmp_path: Path) -> None:
    start = card(tmp_path, "start", 1000, kind="detector")
    detector = card(tmp_path, "detector", 2000, kind="detector", start=start)
    teacher = card(tmp_path, "teacher", 3000, kind="detector", detector="not used")
    own = card(tmp_path, "own", 4000, kind="cooperative", detector=detector, teacher=teacher)
    found = training_places(own)
    assert found.known and sorted(found.towns) == [(k, k + 9) for k in (1000, 2000, 3000, 4000)]
    assert found.include("town", 1005) and not found.include("town", 1500)
    assert TrainingPlaces.from_data(json.loads(json.dumps({"known": True, "towns": found.towns}))) == found
    gone = card(tmp_path, "other", 4000, kind="cooperative", detector=str(tmp_path / "gone.safetensors"))
    assert not training_places(gone).known, "nobody knows where its detector was trained"
    itself = card(tmp_path, "itself", 5000, kind="detector", start=str(tmp_path / "itself.safetensors"))
    assert training_places(itself).towns == ((5000, 5009),)
