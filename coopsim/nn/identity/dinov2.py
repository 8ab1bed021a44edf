"""DINOv2 (Oquab et al. 2023) as it stands: crops of objects to the tokens of one of its blocks, without fine-tuning.

DINO-CoDT (He et al., sec. III-G, eq. 7-8) takes the output of block 31, after AnyLoc (Keetha et al. 2023). Only the
largest model, ViT-g/14, has as many: 40 blocks, tokens of 1536 numbers. How the tokens of a crop become one vector the
paper does not say.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.support.checks import require_choice, require_count

PAPERS_BLOCK = 31
"""Block whose output the paper takes, counted from 1."""

POOLINGS = ("class", "mean")
"""The class token, which the model was trained to describe a whole picture with; or the mean of the patches' tokens,
which says more of colours and less of what kind of thing it is."""

_MEAN, _DEVIATION = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)  # of ImageNet, as the model was trained


class DinoV2(nn.Module):
    """Frozen DINOv2 that embeds crops.

    The vectors are tokens as the block gives them, without the normalisation behind the last block.

    Args:
        model: folder with the model as `transformers` stores it, or its id on the hub, such as "facebook/dinov2-giant":
            it is downloaded unless it is there already.
        block: number of the block whose output is taken, from 1; None: `PAPERS_BLOCK`, or the last one if there are
            fewer. Blocks behind it are left out.
        pooling: one of `POOLINGS`.

    Raises:
        MissingDependencyError: `transformers` is not installed.
        InvalidValueError: there is no such model or block, or it is another kind of model.
        UnknownNameError: there is no such pooling.
    """

    def __init__(self, model: str | Path, block: int | None = None, pooling: str = "class") -> None:
        super().__init__()
        require_choice("pooling", pooling, POOLINGS)
        if importlib.util.find_spec("transformers") is None:
            raise MissingDependencyError("DINOv2 needs transformers: pip install 'coopsim[pretrained]'")
        from transformers import AutoConfig, AutoModel

        path = Path(model).expanduser()
        where = str(path) if path.exists() else str(model)
        try:
            config = AutoConfig.from_pretrained(where)
        except (OSError, ValueError) as error:
            raise InvalidValueError(
                f"model must be a folder with DINOv2 or its id on the hub, got {model!r}"
            ) from error
        if not str(config.model_type).startswith("dinov2"):
            raise InvalidValueError(f"model must be a DINOv2, {model!r} is a {config.model_type}")
        most = int(config.num_hidden_layers)
        block = min(PAPERS_BLOCK, most) if block is None else block
        require_count(1, most, block=block)
        try:
            whole = AutoModel.from_pretrained(where)
        except (OSError, ValueError) as error:
            raise InvalidValueError(f"{where}: the weights of DINOv2 are missing or broken") from error
        self.embeddings, self.blocks = whole.embeddings, nn.ModuleList(whole.encoder.layer[:block])
        self.dim, self.patch_px = int(config.hidden_size), int(config.patch_size)
        self._first_patch = 1 + int(getattr(config, "num_register_tokens", 0))
        self._pooling = pooling
        self.register_buffer("mean", torch.tensor(_MEAN)[:, None, None], persistent=False)
        self.register_buffer("deviation", torch.tensor(_DEVIATION)[:, None, None], persistent=False)
        self.eval().requires_grad_(False)

    def forward(self, crops: Tensor) -> Tensor:
        """Return unit vectors (K, D).

        Args:
            crops: (K, 3, E, E) in [0, 255]; E divides by `patch_px`.
        """
        tokens = self.embeddings((crops - self.get_buffer("mean")) / self.get_buffer("deviation"))
        for block in self.blocks:
            tokens = block(tokens)
            tokens = tokens[0] if isinstance(tokens, tuple) else tokens  # as some versions return them
        tokens = tokens.float()
        pooled = tokens[:, 0] if self._pooling == "class" else tokens[:, self._first_patch :].mean(dim=1)
        return functional.normalize(pooled, dim=1)
