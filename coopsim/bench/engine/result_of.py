"""The result of a cell from its evaluation, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from coopsim.bench.evaluate import Evaluation
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count


def result_of(cell: Cell, evaluation: Evaluation, arithmetic: str) -> CellResult:
    """Return the evaluation of a cell as its result.

    Raises:
        InvalidValueError: the policy's `counts` are no integers of 64 bits by name, or its `method` is no text.
    """
    score = evaluation.score
    if not isinstance(evaluation.method, str):
        raise InvalidValueError(f"method must be a text, got {evaluation.method!r}")
    return CellResult(
        cell,
        values=_as_floats(score.values),
        agents={name: _as_floats(agent.values) for name, agent in score.agents.items()},
        rewards=np.asarray(evaluation.rewards, np.float64),
        messages=asdict(evaluation.messages),
        place_seed=evaluation.place_seed,
        counts=_as_counts(evaluation.counts),
        method=evaluation.method,
        arithmetic=arithmetic,
        bound=evaluation.bound,
    )


def _as_floats(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _as_counts(counts: Mapping[str, int]) -> dict[str, int]:
    for name, count in counts.items():
        if not isinstance(name, str):
            raise InvalidValueError(f"counts must be by name, got {name!r}")
        require_count(-(2**63), 2**63 - 1, **{f"counts[{name!r}]": count})
    return {name: int(count) for name, count in counts.items()}
