"""V2X-ViT: attention over agents of several kinds, and in windows of several sizes inside each agent's map (Xu et al.,
"V2X-ViT: Vehicle-to-Everything Cooperative Perception with Vision Transformer", ECCV 2022).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.attention import MASKED, DelayCode, WindowAttention, feed_forward
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, Patches, start_as_zeros
from coopsim.support.checks import require_choice


@dataclass(frozen=True, slots=True)
class _Size:
    stride: int
    width: int
    heads: int
    window_heads: tuple[int, ...]
    windows: tuple[int, ...]
    depth: int


_SIZES = {"small": _Size(2, 64, 2, (2, 2), (4, 8), 2), "reference": _Size(1, 256, 8, (16, 8, 4), (4, 8, 16), 3)}


@FUSIONS.register("v2x_vit")
class V2XViT(FeatureFusion):
    """Fuse by blocks of attention over agents, attention in windows, and a feed-forward part (section 3.3).

    Each agent's tokens begin with a code of its message's delay (section 3.2.1, see `DelayCode`). A block is

        x <- x + HMSA(norm(x))    over the agents in each place, by their kinds (eq. 2 to 5, see `AgentsByKind`)
        x <- x + MSwin(norm(x))   in windows of several sizes inside each agent's map (see `SplitWindows`)
        x <- x + MLP(norm(x))

    Cells are fused as `Patches` has it, with logits that are linear in each agent's tokens before the last block, and
    with the receiver's tokens after it; the last block is computed for the receiver alone.

    The published code numbers delays in frames and looks them up in a table that is trained; here a delay is a real
    number of seconds. The correction for how agents moved meanwhile is in the warp, the prior of speed is left out, and
    so is dropout, as trainings here use no generator that all share.

    Args:
        features: number of channels.
        size: "small", with patches of 2 x 2 cells, or "reference", the paper's, a token a cell.

    Raises:
        InvalidValueError: features is not positive.
        UnknownNameError: there is no such size.
    """

    def __init__(self, features: int = 64, *, size: str = "small") -> None:
        super().__init__(features)
        require_choice("size", size, _SIZES)
        chosen = _SIZES[size]
        self.patches = Patches(features, chosen.width, chosen.stride, max(chosen.windows))
        self.delay = DelayCode(chosen.width)
        self.blocks = nn.ModuleList(_Block(chosen) for _ in range(chosen.depth))
        self.norm = nn.LayerNorm(chosen.width)
        self.weigh = start_as_zeros(nn.Linear(chosen.width, chosen.stride**2))

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        tokens, valid = self.patches.tokens(own, own_mask, others, mask)
        tokens = self.delay(tokens, context.delay_s)
        kinds = [context.own_kind, *context.kind.long().tolist()]
        for block in self.blocks[:-1]:
            tokens = block(tokens, valid, kinds)
        logits = self.patches.logits(own, others, self.weigh(tokens))
        weights = self.weights(logits, own_mask, mask, context)
        found = self.blocks[-1](tokens, valid, kinds, receivers=1)
        return self.patches.fuse(own, others, mask, weights, self.norm(found[0]))


class _Block(nn.Module):
    """Attention over agents, in windows, and a feed-forward part."""

    def __init__(self, size: _Size) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(size.width) for _ in range(2))
        self.agents = AgentsByKind(size.width, size.heads)
        self.windows = SplitWindows(size.width, size.window_heads, size.windows)
        self.forward_part = feed_forward(size.width)

    def forward(self, tokens: Tensor, valid: Tensor, kinds: list[int], receivers: int | None = None) -> Tensor:
        """Return the tokens of the first agents only, of all by default."""
        found = self.agents(self.norms[0](tokens), valid, kinds, receivers)
        tokens = tokens[: len(found)] + found
        # The receiver has now heard of all places that anyone sees; of a sender's map its own ones count.
        seen = torch.cat([valid.any(0, keepdim=True), valid[1 : len(found)]])
        tokens = tokens + self.windows(self.norms[1](tokens), seen)
        after: Tensor = tokens + self.forward_part(tokens)
        return after


class SplitWindows(nn.Module):
    """Attention in windows of several sizes at once, joined by split attention (Zhang et al., "ResNeSt", 2020).

    Channel by channel, sizes are weighted by the softmax of a small network's output for the mean over the map.
    """

    def __init__(self, width: int, heads: tuple[int, ...], windows: tuple[int, ...]) -> None:
        super().__init__()
        self.branches = nn.ModuleList(
            WindowAttention(width, number, window) for number, window in zip(heads, windows, strict=True)
        )
        hidden = width // 2
        self.choose = nn.Sequential(
            nn.Linear(width, hidden), nn.LayerNorm(hidden), nn.ReLU(), nn.Linear(hidden, width * len(windows))
        )

    def forward(self, tokens: Tensor, valid: Tensor) -> Tensor:
        """Return (L, h, w, width) of tokens (L, h, w, width) and the valid ones (L, h, w)."""
        found = torch.stack([branch(tokens, valid) for branch in self.branches])
        present = valid[..., None].to(found.dtype)
        mean = (found.sum(0) * present).sum((1, 2)) / present.sum((1, 2)).clamp_min(1)
        weights = self.choose(mean).view(len(tokens), len(found), -1).softmax(1).transpose(0, 1)
        joined: Tensor = (found * weights[:, :, None, None]).sum(0)
        return joined


KINDS = 3
"""Kinds of agents that networks tell apart: cars, roadside units, drones."""


class AgentsByKind(nn.Module):
    """Attend, in each place, from every agent to all that are valid there; V2X-ViT's heterogeneous attention (HMSA).

    With k(i) the kind of agent i, each head has (eq. 2 to 5)

        a_ij = softmax_j((Q_k(i) x_i) W_k(j)k(i) (K_k(j) x_j) / sqrt(d))
        out_i = O_k(i) [sum_j a_ij M_k(j)k(i) (V_k(j) x_j)]

    A product of two matrices of a kind or a pair of kinds is one matrix, made before tokens are multiplied by it.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self._heads = heads
        depth = width // heads
        bound = width**-0.5
        self.query, self.key, self.value, self.out = (
            nn.Parameter(torch.empty(KINDS, width, width).uniform_(-bound, bound)) for _ in range(4)
        )
        self.out_bias = nn.Parameter(torch.zeros(KINDS, width))
        same = torch.eye(depth).expand(KINDS, KINDS, heads, depth, depth)
        self.relation, self.message = nn.Parameter(same.clone()), nn.Parameter(same.clone())

    def forward(self, tokens: Tensor, valid: Tensor, kinds: Sequence[int], receivers: int | None = None) -> Tensor:
        """Return (receivers, h, w, width) for the first `receivers` agents, all by default.

        Args:
            tokens: (L, h, w, width).
            valid: (L, h, w) bool, the tokens that are attended to.
            kinds: kinds of the L agents.
            receivers: number of agents.
        """
        asking = range(len(tokens) if receivers is None else receivers)
        offered = {kind: self._offered(tokens, kinds, kind) for kind in {kinds[i] for i in asking}}
        return torch.stack([self._found(tokens[i], kinds[i], *offered[kinds[i]], valid) for i in asking])

    def _offered(self, tokens: Tensor, kinds: Sequence[int], to: int) -> tuple[Tensor, Tensor]:
        """Return keys and values (L, h, w, width) that all agents offer to those of a kind."""
        offers = []
        for each, kind in zip(tokens, kinds, strict=True):
            keys = self._product(self.relation[kind, to], self.key[kind])
            values = self._product(self.message[kind, to], self.value[kind])
            offers.append(functional.linear(each, torch.cat([keys, values])))
        keys, values = torch.stack(offers).chunk(2, -1)
        return keys, values

    def _product(self, by_head: Tensor, matrix: Tensor) -> Tensor:
        """Return the matrix (width, width) of which each head's rows are multiplied by its own (heads, d, d)."""
        return torch.matmul(by_head, matrix.view(self._heads, -1, matrix.shape[-1])).flatten(0, 1)

    def _found(self, tokens: Tensor, kind: int, keys: Tensor, values: Tensor, valid: Tensor) -> Tensor:
        """Return what one agent finds, (h, w, width)."""
        query = functional.linear(tokens, self.query[kind])
        by_head = (*keys.shape[:-1], self._heads, keys.shape[-1] // self._heads)
        logits = (keys * query).view(by_head).sum(-1) / by_head[-1] ** 0.5
        weights = (logits.float() + (~valid)[..., None] * MASKED).softmax(0) * valid[..., None]
        found = (values.reshape(by_head) * weights[..., None].to(values.dtype)).sum(0).flatten(-2)
        return functional.linear(found, self.out[kind], self.out_bias[kind])
