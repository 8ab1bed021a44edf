"""Attention over agents in each place, with weights that depend on what kinds of agents they are."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.attention.windows import MASKED

KINDS = 3
"""Kinds of agents that networks tell apart: cars, roadside units, drones."""


class AgentsByKind(nn.Module):
    """Attend, in each place, from every agent to all that are valid there; V2X-ViT's heterogeneous attention (HMSA).

    With k(i) the kind of agent i, each head has (eq. 2 to 5)

        a_ij = softmax_j((Q_k(i) x_i) W_k(j)k(i) (K_k(j) x_j) / sqrt(d))
        out_i = O_k(i) [sum_j a_ij M_k(j)k(i) (V_k(j) x_j)]

    A product of two matrices of a kind or a pair of kinds is one matrix, made before tokens are multiplied by it.

    Args:
        width: channels of a token.
        heads: number of heads; divides `width`.
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
        """Return what the first `receivers` agents find, all by default: (receivers, h, w, width).

        Args:
            tokens: (L, h, w, width).
            valid: (L, h, w) bool, the tokens that are attended to.
            kinds: of the L agents.
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
