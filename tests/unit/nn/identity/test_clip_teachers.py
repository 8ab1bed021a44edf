"""CLIP as a teacher: a tiny random one, in a folder as `transformers` stores it."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("transformers", reason="transformers is not installed: pip install 'coopsim[pretrained]'")

import torch
import transformers
from clips import SEEING, seeing_clip

from coopsim.errors import CoopsimError, InvalidValueError, MissingDependencyError
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.train import make_task
from coopsim.nn.identity.clip_teachers import ClipTeachers, prompt_of

BOXES = np.array([[10.0, 0.0, 1.0, 4.0, 2.0, 1.5, 0.0], [5.0, 5.0, 1.0, 1.0, 1.0, 2.0, np.pi / 2]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clip")
    sizes = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    letters = [chr(code) for code in range(33, 127)]
    words = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    vocabulary = {word: number for number, word in enumerate(words)}
    config = transformers.CLIPConfig(
        text_config={
            **sizes, "vocab_size": len(words), "max_position_embeddings": 77,
            "bos_token_id": len(words) - 2, "eos_token_id": len(words) - 1,
        },
        vision_config={**sizes, "image_size": 32, "patch_size": 16},
        projection_dim=12,
    )  # fmt: skip
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(path)
    transformers.CLIPTokenizer(vocab=vocabulary, merges=[]).save_pretrained(path)
    return path


def test_the_prompt_is_the_source_s() -> None:
    assert prompt_of(0, BOXES[0]) == (
        "The category of the object is car, and its location can be represented by four coordinates: (12.0, 1.0), "
        "(12.0, -1.0), (8.0, -1.0), and (8.0, 1.0)."
    )


def test_pictures_and_words_become_vectors_of_length_one(folder: Path) -> None:
    teachers = ClipTeachers(folder).train()
    crop = np.random.default_rng(0).integers(0, 255, (20, 40, 3)).astype(np.uint8)
    found = teachers.vectors(np.array([0, 7]), BOXES, [None, crop])
    assert teachers.dim == 12 and not teachers.training and not any(p.requires_grad for p in teachers.parameters())
    assert found["image"][0].tolist() == [1] and found["text"][0].tolist() == [0, 1]
    for rows, vectors in found.values():
        assert vectors.shape == (len(rows), 12) and vectors.norm(dim=1).tolist() == pytest.approx([1.0] * len(rows))
    words = found["text"][1]
    assert not torch.allclose(words[0], words[1], atol=1e-3)
    brighter = teachers.vectors(np.array([0, 7]), BOXES, [crop, 255 - crop])["image"][1]
    assert torch.allclose(brighter[0], found["image"][1][0], atol=1e-5)
    assert not torch.allclose(brighter[1], brighter[0], atol=1e-3)
    assert teachers.vectors(np.zeros(0, int), np.zeros((0, 7)), [])["text"][1].shape == (0, 12)


def test_points_learn_from_pictures_and_words(folder: Path) -> None:
    recipe = TrainingRecipe(
        "x", "point_identity", teacher=str(folder), network={"widths": [4, 4, 4, 4, 8], "dim": 6, "points": 16},
        world=asdict(SEEING),
    )  # fmt: skip
    task = make_task(recipe, 0)
    batch = task.collate(task.cut(seeing_clip(), np.random.default_rng(0)))
    shown = [crop for crop in batch.crops if crop is not None]
    assert shown and all(crop.ndim == 3 and crop.size for crop in shown) and len(batch.crops) == len(batch.seen)
    losses = task(batch)
    assert set(losses) == {"loss", "positive", "triplet", "image", "text"}
    (losses["image"] + losses["text"]).backward()
    assert task.net.encoder.last.weight.grad.any()
    assert task.files(task.net, "x")[0].metadata["teachers"] == "CLIP"
    alone = make_task(replace(recipe, teacher=None), 0)
    assert alone.files(alone.net, "x")[0].metadata["teachers"] == "none"


def test_what_is_no_clip_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="must be a folder with a CLIP model"):
        ClipTeachers(tmp_path / "nothing")
    with pytest.raises(InvalidValueError, match="no CLIP model with a tokenizer can be read"):
        ClipTeachers(tmp_path)
    transformers.Dinov2Config(hidden_size=8, num_hidden_layers=1).save_pretrained(tmp_path)
    with pytest.raises(CoopsimError, match="must be a CLIP model, is a dinov2"):
        ClipTeachers(tmp_path)


def test_without_transformers_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[pretrained\]'"):
        ClipTeachers(".")
