"""The script gives exactly the models that are shipped, and these are, to the bit, what code once made at run time."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

import make_actors
import numpy as np
import pytest
from actor_shapes.figure import bend_limbs
from numpy.typing import NDArray

from coopsim.world.models import make_models
from coopsim.world.models.built_in import ACTORS

ARRAYS = ("size_m", "vertices", "faces", "tint", "reflectivity", "color", "accented", "poses")
AS_MADE_AT_RUN_TIME = "237a76e2bba0bc97511aafda1f4ec9e590c8dcca2c8b67742f5e8d4e3143a83a"


def test_every_model_is_to_the_bit_what_code_made_at_run_time() -> None:
    digest = hashlib.sha256()
    for model in make_models(varied=True, at_rest=True):
        text = f"{model.name} {int(model.label)} {model.cycle_m!r} {model.share!r} {model.stands}"
        digest.update(text.encode())
        for name in ARRAYS:
            array = getattr(model, name)
            digest.update(f"{name} {array.dtype} {array.shape}".encode())
            digest.update(array.tobytes())
    assert digest.hexdigest() == AS_MADE_AT_RUN_TIME


def test_the_script_makes_what_is_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["make_actors.py", "--out", str(tmp_path)])
    make_actors.main()
    with np.load(tmp_path / ACTORS.name, allow_pickle=False) as made, np.load(ACTORS, allow_pickle=False) as shipped:
        assert made.files == shipped.files
        for name in made.files:
            assert made[name].dtype == shipped[name].dtype and made[name].tobytes() == shipped[name].tobytes(), name


def test_the_card_is_of_the_file() -> None:
    card, content = json.loads(ACTORS.with_suffix(".json").read_text()), ACTORS.read_bytes()
    assert (card["digest"], card["bytes"]) == (hashlib.sha256(content).hexdigest(), len(content))
    assert len(content) < 500_000  # compressed


def test_reach_keeps_the_lengths_of_the_links_and_arrives() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        start: NDArray[np.float64] = rng.normal(size=(2, 3))
        end = start + rng.normal(size=(2, 3))
        middle, tip = np.moveaxis(bend_limbs(start, end, (0.7, 0.6), (1.0, 0.2, 0.1)), 1, 0)
        np.testing.assert_allclose(np.linalg.norm(middle - start, axis=1), 0.7, rtol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(tip - middle, axis=1), 0.6, rtol=1e-9)
        far = np.linalg.norm(end - start, axis=1)
        missed = np.linalg.norm(tip - end, axis=1)
        np.testing.assert_allclose(missed, np.maximum(far - 0.999 * 1.3, 0.0), atol=1e-9)
