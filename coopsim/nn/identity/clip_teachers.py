"""YOLOO's teachers: a frozen CLIP's vectors of pictures of objects, and of words about them (Gu et al., III-C1)."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.taxonomy import CLASS_NAMES

_MEAN, _DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)  # of CLIP's pictures

Crop = NDArray[np.uint8]
"""A part of a picture (h, w, 3)."""


class ClipTeachers(nn.Module):
    """Image and text encoders of a CLIP model; nothing is learned here, and nothing downloaded.

    Crops are resized to the size that the model was trained with; the source says 512 x 512, which no CLIP has.

    Args:
        folder: with the model and its tokenizer, as `transformers` stores them.

    Raises:
        MissingDependencyError: `transformers` is not installed.
        InvalidValueError: the folder is missing, or holds no CLIP model with a tokenizer.
    """

    def __init__(self, folder: str | Path) -> None:
        super().__init__()
        if importlib.util.find_spec("transformers") is None:
            raise MissingDependencyError("CLIP teachers need transformers: pip install 'coopsim[pretrained]'")
        import transformers

        path = Path(folder).expanduser()
        if not path.is_dir():
            raise InvalidValueError(
                f"teacher must be a folder with a CLIP model, as transformers stores it, got {str(folder)!r}"
            )
        try:
            kind = transformers.AutoConfig.from_pretrained(path, local_files_only=True).model_type
            if kind != "clip":
                raise InvalidValueError(f"{path}: teacher must be a CLIP model, is a {kind}")
            self._model: Any = transformers.CLIPModel.from_pretrained(path, local_files_only=True)
            self._tokenizer: Any = transformers.AutoTokenizer.from_pretrained(path, local_files_only=True)
        except (OSError, ValueError) as error:
            if isinstance(error, InvalidValueError):
                raise
            raise InvalidValueError(f"{path}: no CLIP model with a tokenizer can be read: {error}") from error
        self._edge_px = int(self._model.config.vision_config.image_size)
        self._longest = int(self._model.config.text_config.max_position_embeddings)
        self.dim = int(self._model.config.projection_dim)
        self.register_buffer("_mean", torch.tensor(_MEAN)[:, None, None], persistent=False)
        self.register_buffer("_deviation", torch.tensor(_DEVIATION)[:, None, None], persistent=False)
        self.requires_grad_(False).eval()

    def train(self, mode: bool = True) -> Self:
        """Stay as it is: a teacher does not learn."""
        return super().train(False)

    def vectors(self, label: Ints, boxes: Floats, crops: Sequence[Crop | None]) -> Mapping[str, tuple[Tensor, Tensor]]:
        """Return by teacher's name, "image" and "text", the rows (K,) with vectors, and these: (K, dim).

        Args:
            label: (M,) classes.
            boxes: (M, 7) x, y, z, l, w, h, yaw.
            crops: (M) pictures; None: there is none.
        """
        shown = [row for row, crop in enumerate(crops) if crop is not None]
        prompts = [prompt_of(int(each), box) for each, box in zip(label, boxes, strict=True)]
        device = self.get_buffer("_mean").device
        with torch.no_grad():
            return {
                "image": (
                    torch.tensor(shown, dtype=torch.int64, device=device),
                    self._images([crops[k] for k in shown]),
                ),
                "text": (torch.arange(len(prompts), device=device), self._texts(prompts)),
            }

    def _images(self, crops: Sequence[Crop | None]) -> Tensor:
        mean, size = self.get_buffer("_mean"), (self._edge_px, self._edge_px)
        if not crops:
            return mean.new_zeros(0, self.dim)
        resized = [
            functional.interpolate(
                torch.from_numpy(np.ascontiguousarray(crop)).to(mean.device).permute(2, 0, 1)[None].float() / 255,
                size, mode="bilinear", antialias=True,
            )
            for crop in crops
        ]  # fmt: skip
        pixels = (torch.cat(resized) - mean) / self.get_buffer("_deviation")
        found = self._model.visual_projection(self._model.vision_model(pixel_values=pixels).pooler_output)
        return functional.normalize(found.float(), dim=1)

    def _texts(self, prompts: Sequence[str]) -> Tensor:
        if not prompts:
            return self.get_buffer("_mean").new_zeros(0, self.dim)
        tokens = self._tokenizer(
            list(prompts), padding=True, truncation=True, max_length=self._longest, return_tensors="pt"
        ).to(self.get_buffer("_mean").device)
        found = self._model.text_model(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"])
        return functional.normalize(self._model.text_projection(found.pooler_output).float(), dim=1)


def prompt_of(label: int, box: Floats) -> str:
    """Return the source's sentence about an object: its class, and the corners of its box (7,) on the ground, in m."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    x, y = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]).T * box[3:5, None] / 2
    corners = [
        f"({a:.1f}, {b:.1f})" for a, b in zip(box[0] + cos * x - sin * y, box[1] + sin * x + cos * y, strict=True)
    ]
    return (
        f"The category of the object is {CLASS_NAMES[label]}, and its location can be represented by four "
        f"coordinates: {', '.join(corners[:3])}, and {corners[3]}."
    )
