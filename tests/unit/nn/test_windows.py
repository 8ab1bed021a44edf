"""Attention in windows: who sees whom, against the equation written out."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.attention import WindowAttention  # noqa: E402

torch.set_num_threads(1)
WIDTH, ROWS, COLUMNS, AGENTS = 8, 8, 12, 3


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def made(**options: bool) -> WindowAttention:
    attention = WindowAttention(WIDTH, 2, 4, **options)
    with torch.no_grad():
        for number, weights in enumerate(attention.parameters()):
            weights.copy_(draw(*weights.shape, seed=number))
    return attention


def place(agent: int, row: int, column: int, *, spread: bool, together: bool) -> tuple[int, ...]:
    """Return the window of a token."""
    window = (row % 2, column % 3) if spread else (row // 4, column // 4)
    return (0 if together else agent, *window)


def written_out(attention: WindowAttention, tokens: torch.Tensor, valid: torch.Tensor, **options: bool) -> torch.Tensor:
    """Return the result of the equation, token by token."""
    step = (2, 3) if options["spread"] else (1, 1)
    where = [(a, r, c) for a in range(len(tokens)) for r in range(ROWS) for c in range(COLUMNS)]
    query, key, value = (tokens @ attention.mix.weight.T + attention.mix.bias).chunk(3, -1)
    out = torch.zeros_like(tokens)
    for one in where:
        seen = [each for each in where if place(*each, **options) == place(*one, **options) and valid[each]]
        if not seen:
            continue
        heads = []
        for head, part in enumerate((slice(0, 4), slice(4, 8))):
            logits = []
            for each in seen:
                offset = ((one[1] - each[1]) // step[0] + 3) * 7 + (one[2] - each[2]) // step[1] + 3
                bias = attention.bias[int(one[0] != each[0]), head, offset]
                logits.append(query[one][part] @ key[each][part] / 2 + bias)
            heads.append(torch.stack(logits).softmax(0) @ torch.stack([value[each][part] for each in seen]))
        out[one] = attention.out(torch.cat(heads))
    return out


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize("together", [False, True])
def test_attention_by_the_equation(spread: bool, together: bool) -> None:
    options = {"spread": spread, "together": together}
    attention, tokens = made(**options), draw(2, ROWS, COLUMNS, WIDTH)
    valid = draw(2, ROWS, COLUMNS, seed=9) > -0.3
    with torch.no_grad():
        expected = written_out(attention, tokens, valid, **options)
        found = attention(tokens, valid)
    assert torch.allclose(found, expected, atol=1e-4)


def test_in_a_window_that_nobody_sees_all_is_finite() -> None:
    attention = made(together=True)
    tokens = draw(AGENTS, ROWS, COLUMNS, WIDTH).requires_grad_()
    found = attention(tokens, torch.zeros(AGENTS, ROWS, COLUMNS, dtype=torch.bool))
    found.sum().backward()
    assert found.isfinite().all() and tokens.grad is not None and tokens.grad.isfinite().all()
    with torch.autocast("cpu", torch.bfloat16):
        assert attention(tokens, torch.zeros(AGENTS, ROWS, COLUMNS, dtype=torch.bool)).isfinite().all()
