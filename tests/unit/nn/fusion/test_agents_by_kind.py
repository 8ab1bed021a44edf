"""Attention over agents by kind: against the equation written out."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.cooperative.perceiver import KINDS as NAMES  # noqa: E402
from coopsim.nn.fusion.v2x_vit import KINDS, AgentsByKind  # noqa: E402

torch.set_num_threads(1)
WIDTH, HEADS, DEPTH = 8, 2, 4
OF = [0, 1, 2, 1]


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def made() -> AgentsByKind:
    attention = AgentsByKind(WIDTH, HEADS)
    with torch.no_grad():
        for number, weights in enumerate(attention.parameters()):
            weights.copy_(0.5 * draw(*weights.shape, seed=number))
    return attention


def written_out(made: AgentsByKind, tokens: torch.Tensor, valid: torch.Tensor, i: int) -> torch.Tensor:
    """Return what agent i finds in one place, of tokens (L, WIDTH)."""
    found = []
    for head in range(HEADS):
        part = slice(head * DEPTH, (head + 1) * DEPTH)
        query = (made.query[OF[i]] @ tokens[i])[part]
        logits, values = [], []
        for j in range(len(tokens)):
            if valid[j]:
                key, value = (weights[OF[j]] @ tokens[j] for weights in (made.key, made.value))
                logits.append(query @ made.relation[OF[j], OF[i], head] @ key[part] / DEPTH**0.5)
                values.append(made.message[OF[j], OF[i], head] @ value[part])
        found.append(torch.stack(logits).softmax(0) @ torch.stack(values))
    return made.out[OF[i]] @ torch.cat(found) + made.out_bias[OF[i]]


def test_attention_by_the_equation() -> None:
    attention, tokens = made(), draw(4, 2, 3, WIDTH)
    valid = torch.ones(4, 2, 3, dtype=torch.bool)
    valid[1:3, 0] = False
    found = attention(tokens, valid, OF)
    for i in range(4):
        for row in range(2):
            expected = written_out(attention, tokens[:, row, 1], valid[:, row, 1], i)
            assert torch.allclose(found[i, row, 1], expected, atol=1e-5)


def test_what_only_the_receiver_finds_is_the_same() -> None:
    attention, tokens, valid = made(), draw(4, 2, 3, WIDTH), draw(4, 2, 3, seed=1) > 0
    assert torch.equal(attention(tokens, valid, OF, 1), attention(tokens, valid, OF)[:1])


def test_kinds_make_a_difference() -> None:
    attention, tokens, valid = made(), draw(2, 1, 1, WIDTH), torch.ones(2, 1, 1, dtype=torch.bool)
    found = [attention(tokens, valid, [0, kind], 1) for kind in range(KINDS)]
    assert not torch.allclose(found[0], found[1]) and not torch.allclose(found[1], found[2])
    assert len(NAMES) == KINDS


def test_where_nobody_is_valid_nothing_is_found() -> None:
    attention, tokens = made(), draw(2, 1, 1, WIDTH).requires_grad_()
    found = attention(tokens, torch.zeros(2, 1, 1, dtype=torch.bool), [0, 1])
    assert torch.allclose(found[:, 0, 0], attention.out_bias[:2])
    found.sum().backward()
    assert tokens.grad is not None and tokens.grad.isfinite().all()
