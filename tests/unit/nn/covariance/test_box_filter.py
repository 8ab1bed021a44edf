"""The filter in torch is the library's: same means, same covariances; and gradients pass through it."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from coopsim.nn.covariance.box_filter import BoxFilter, TensorBeliefs, innovation_of, squared_distance
from coopsim.tracking.motion.constant_velocity import Beliefs, ConstantVelocity
from coopsim.types.estimates import diagonals

MOTION = ConstantVelocity(
    initial_velocity_variance=50.0,
    process_variance_per_s=(1.0, 2.0, 0.3, 0.1, 0.1, 0.1, 0.7),
    process_velocity_variance_per_s=4.0,
)
FILTER = BoxFilter(
    torch.tensor(MOTION.process_variance_per_s, dtype=torch.float64),
    torch.tensor(4.0, dtype=torch.float64),
    torch.tensor(50.0, dtype=torch.float64),
)


def boxes(rng: np.random.Generator, count: int = 5) -> np.ndarray:
    places = rng.normal(scale=30.0, size=(count, 3))
    return np.concatenate([places, rng.uniform(0.5, 5.0, (count, 3)), rng.uniform(-4, 4, (count, 1))], axis=1)


def assert_same(ours: TensorBeliefs, library: Beliefs) -> None:
    np.testing.assert_allclose(ours.mean.numpy(), library.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.covariance.numpy(), library.covariance, rtol=0, atol=1e-9)


@given(st.integers(0, 2**31))
def test_it_equals_the_librarys_filter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, variance = boxes(rng), rng.uniform(1e-3, 5.0, (5, 7))
    ours = FILTER.initiate(torch.from_numpy(seen), torch.from_numpy(diagonals(variance)))
    library = MOTION.initiate(seen, diagonals(variance))
    assert_same(ours, library)
    for dt_s in (0.1, 0.0, 0.5, 0.1):
        seen = seen + rng.normal(scale=0.5, size=seen.shape)
        seen[:, 6] += rng.choice([0.0, np.pi, 2 * np.pi], 5)  # headings turn round, and past pi
        variance = rng.uniform(1e-3, 5.0, (5, 7))
        ours, library = FILTER.predict(ours, dt_s), MOTION.predict(library, dt_s)
        assert_same(ours, library)
        innovation = innovation_of(ours, torch.from_numpy(seen))
        ours, _ = FILTER.update(ours, innovation, torch.from_numpy(diagonals(variance)))
        library = MOTION.update(library, seen, diagonals(variance))
        assert_same(ours, library)


def test_the_distance_is_that_of_the_innovations_covariance() -> None:
    rng = np.random.default_rng(0)
    seen, variance = boxes(rng), rng.uniform(0.1, 1.0, (5, 7))
    beliefs = FILTER.predict(FILTER.initiate(torch.from_numpy(seen), torch.from_numpy(diagonals(variance))), 0.1)
    innovation = innovation_of(beliefs, torch.from_numpy(seen + 0.3))
    _, factor = FILTER.update(beliefs, innovation, torch.from_numpy(diagonals(variance)))
    system = beliefs.covariance[:, :7, :7].numpy() + diagonals(variance)
    expected = np.einsum("ni,nij,nj->n", innovation, np.linalg.inv(system), innovation)
    np.testing.assert_allclose(squared_distance(innovation, factor), expected, rtol=1e-10)


def test_gradients_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    first, second = (torch.from_numpy(boxes(rng, 2)) for _ in range(2))

    def updated(variance: torch.Tensor) -> torch.Tensor:
        beliefs = FILTER.predict(FILTER.initiate(first, torch.diag_embed(variance)), 0.1)
        return FILTER.update(beliefs, innovation_of(beliefs, second), torch.diag_embed(2 * variance))[0].mean

    variance = torch.from_numpy(rng.uniform(0.2, 1.0, (2, 7))).requires_grad_()
    assert torch.autograd.gradcheck(updated, (variance,))


def test_some_beliefs_are_replaced_and_the_others_stay() -> None:
    rng = np.random.default_rng(2)
    many = FILTER.initiate(torch.from_numpy(boxes(rng)), torch.eye(7, dtype=torch.float64).expand(5, 7, 7))
    rows = torch.tensor([3, 1])
    changed = many.put(rows, FILTER.predict(many.at(rows), 1.0))
    assert torch.equal(changed.covariance[[0, 2, 4]], many.covariance[[0, 2, 4]])
    assert torch.equal(changed.at(rows).covariance, FILTER.predict(many, 1.0).covariance[rows])
