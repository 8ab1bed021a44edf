"""DINOv2 from a folder: the block that was asked for, and a clear word for what is no DINOv2.

The model is tiny and random; its tokens mean nothing, but go the way that those of a trained one go.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("transformers", reason="transformers is not installed: pip install 'coopsim[pretrained]'")

import torch
import transformers

from coopsim.detection.embedder import make_embedder
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.nn.identity.dinov2 import DinoV2
from coopsim.testing import check_embedder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("dinov2")
    torch.manual_seed(0)
    config = transformers.Dinov2Config(
        hidden_size=12, num_hidden_layers=3, num_attention_heads=2, image_size=28, patch_size=14
    )
    transformers.Dinov2Model(config).save_pretrained(made)
    return made


def crops(count: int = 3) -> torch.Tensor:
    return torch.rand(count, 3, 28, 28, generator=torch.Generator().manual_seed(1)) * 255


@pytest.mark.parametrize("block", [1, 2, 3, None])
@pytest.mark.parametrize("pooling", ["class", "mean"])
def test_vectors_are_tokens_of_the_block(folder: Path, block: int | None, pooling: str) -> None:
    net = DinoV2(folder, block, pooling)
    whole = transformers.Dinov2Model.from_pretrained(folder).eval()
    mean, deviation = (torch.tensor(each)[:, None, None] for each in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)))
    states = whole((crops() / 255 - mean) / deviation, output_hidden_states=True).hidden_states
    tokens = states[3 if block is None else block]
    pooled = tokens[:, 0] if pooling == "class" else tokens[:, 1:].mean(1)
    torch.testing.assert_close(net(crops()), torch.nn.functional.normalize(pooled, dim=1), atol=1e-5, rtol=1e-4)
    assert net.dim == 12 and not any(each.requires_grad for each in net.parameters())


def test_registers_are_no_patches(tmp_path: Path) -> None:
    config = transformers.Dinov2WithRegistersConfig(
        hidden_size=12, num_hidden_layers=2, num_attention_heads=2, image_size=28, patch_size=14, num_register_tokens=3
    )
    whole = transformers.Dinov2WithRegistersModel(config).eval()
    whole.save_pretrained(tmp_path)
    net = DinoV2(tmp_path, 2, "mean")
    tokens = net.embeddings((crops() - net.get_buffer("mean")) / net.get_buffer("deviation"))
    for block in net.blocks:
        tokens = block(tokens)
    assert tokens.shape[1] == 1 + 3 + 4
    expected = torch.nn.functional.normalize(tokens[:, 4:].mean(1), dim=1)
    torch.testing.assert_close(net(crops()), expected)


def test_it_embeds_what_a_detector_finds(folder: Path) -> None:
    spec = f"dinov2(model='{folder}', edge_px=28, pooling=mean)"
    assert make_embedder(spec).dim == 12
    check_embedder(spec)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"block": 4}, InvalidValueError, "block must be an integer"),
        ({"block": 0}, InvalidValueError, "block must be an integer"),
        ({"pooling": "max"}, UnknownNameError, "unknown pooling 'max'"),
    ],
)
def test_bad_options(folder: Path, options: dict[str, object], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        DinoV2(folder, **options)  # type: ignore[arg-type]


def test_what_is_no_dinov2(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="model must be a folder with DINOv2 or its id on the hub"):
        DinoV2(tmp_path)
    transformers.ViTConfig(hidden_size=8, num_hidden_layers=1, num_attention_heads=1).save_pretrained(tmp_path)
    with pytest.raises(InvalidValueError, match="is a vit"):
        DinoV2(tmp_path)
    (tmp_path / "config.json").write_bytes((folder / "config.json").read_bytes())
    with pytest.raises(InvalidValueError, match="the weights of DINOv2 are missing or broken"):
        DinoV2(tmp_path)
    with pytest.raises(InvalidValueError, match="edge_px must be a multiple of 14, the model's patches, got 40"):
        make_embedder(f"dinov2(model='{folder}', edge_px=40)")


def test_numbers_of_a_crop_do_not_depend_on_the_others(folder: Path) -> None:
    net = DinoV2(folder)
    np.testing.assert_allclose(net(crops(4))[2].numpy(), net(crops(4)[2:3])[0].numpy(), atol=1e-5)
