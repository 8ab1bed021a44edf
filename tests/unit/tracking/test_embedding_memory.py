"""The memory of what tracks looked like: by hand, and against a list of lists."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.tracking.track_states import EmbeddingMemory

EAST, NORTH, NORTHEAST = [1.0, 0.0], [0.0, 2.0], [3.0, 3.0]
NONE = [np.nan, np.nan]
HALF = np.sqrt(0.5)


def remembering(*histories: list[list[float]], window: int = 3) -> EmbeddingMemory:
    """Tracks that were born with the first embedding of each history, and saw the others in turn."""
    memory = EmbeddingMemory.blank(0, 2, window)
    memory = memory.join(memory.begin([history[0] for history in histories], 0))
    for row, history in enumerate(histories):
        for time_ns, embedding in enumerate(history[1:], start=1):
            memory = memory.update(np.array([row]), [embedding], time_ns)
    return memory


def test_similarity_is_the_cosine() -> None:
    memory = remembering([EAST], [NORTH])
    got = memory.similarity([EAST, NORTHEAST, [-5.0, 0.0]])
    np.testing.assert_allclose(got, [[1, HALF, -1], [0, HALF, 0]], atol=1e-6)


def test_any_view_may_match() -> None:
    memory = remembering([EAST, NORTH], [EAST])
    np.testing.assert_allclose(memory.similarity([EAST]), [[1], [1]], atol=1e-6)


def test_the_oldest_goes_first() -> None:
    full = remembering([EAST, NORTH, NORTH])
    assert full.similarity([EAST])[0, 0] == pytest.approx(1)
    assert full.update(np.array([0]), [NORTH], 3).similarity([EAST])[0, 0] == pytest.approx(0)


def test_what_has_no_embedding_is_like_nothing() -> None:
    memory = remembering([EAST], [NONE])
    got = memory.similarity([EAST, NONE, [0.0, 0.0], [np.inf, 1.0]])
    np.testing.assert_array_equal(np.isneginf(got), [[False, True, True, True], [True] * 4])
    assert np.isneginf(memory.similarity(np.full((3, 2), np.nan))).all()


def test_a_frame_without_an_embedding_pushes_none_out() -> None:
    memory = remembering([EAST, NONE, NONE, NONE, NONE])
    assert memory.similarity([EAST])[0, 0] == pytest.approx(1)
    assert memory.valid.tolist() == [[False, False, True]]


def test_memories_do_not_change() -> None:
    memory = remembering([EAST], [NORTH])
    before = memory.vectors.copy()
    memory.update(np.array([0, 1]), [NORTH, NORTH], 1)
    np.testing.assert_array_equal(memory.vectors, before)
    with pytest.raises(ValueError, match="read-only"):
        memory.vectors[0, 0, 0] = 1.0


def test_take_and_join_follow_the_tracks() -> None:
    memory = remembering([EAST], [NORTH], [NORTHEAST])
    for index in (np.array([True, False, True]), np.array([0, 2])):
        np.testing.assert_allclose(memory.take(index).similarity([EAST])[:, 0], [1, HALF], atol=1e-6)
    joined = memory.take(np.array([2])).join(memory.take(np.array([0])))
    np.testing.assert_allclose(joined.similarity([EAST])[:, 0], [HALF, 1], atol=1e-6)


def test_rows_may_be_a_mask() -> None:
    memory = remembering([EAST], [NORTH]).update(np.array([False, True]), [EAST], 1)
    np.testing.assert_allclose(memory.similarity([EAST])[:, 0], [1, 1], atol=1e-6)


def test_nothing_is_like_nobody() -> None:
    empty = EmbeddingMemory.blank(0, 4, 3)
    assert len(empty) == 0 and (empty.dim, empty.window) == (4, 3)
    assert empty.similarity(np.ones((5, 4))).shape == (0, 5)
    one = empty.begin(np.ones((1, 4)), 0)
    assert one.similarity(np.zeros((0, 4))).shape == (1, 0)
    assert len(one.update(np.zeros(0, dtype=int), np.zeros((0, 4)), 1).join(empty)) == 1


def test_very_long_and_very_short_embeddings_are_compared_by_direction() -> None:
    memory = remembering([[3e200, 0.0]], [[0.0, 1e-310]])
    np.testing.assert_allclose(memory.similarity([[1e-300, 0.0]])[:, 0], [1, 0], atol=1e-6)


def test_what_is_too_old_is_forgotten_but_not_that_it_was() -> None:
    memory = remembering([EAST, NORTH, NONE, NONE], [EAST], [NONE])
    recent = memory.since(1)
    np.testing.assert_allclose(recent.similarity([EAST, NORTH])[0], [0, 1], atol=1e-6)
    assert recent.known.tolist() == [True, False, False] and recent.ever_known.tolist() == [True, True, False]
    assert memory.since(0) is memory and memory.known.tolist() == [True, True, False]
    assert not memory.since(2).known.any()
    assert recent.take(np.array([0])).since(2).known.tolist() == [False]


@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=25),
    st.integers(0, 30),
    st.integers(0, 2**31),
)
def test_it_is_a_table_of_queues(window: int, events: list[tuple[int, bool]], oldest_ns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    queues: list[list[tuple[int, np.ndarray]]] = [[], [], []]
    memory = EmbeddingMemory.blank(3, 5, window)
    for time_ns, (row, seen) in enumerate(events):
        embedding = rng.normal(size=5) if seen else np.zeros(5)
        memory = memory.update(np.array([row]), embedding[None], time_ns)
        if seen:
            queues[row] = [*queues[row], (time_ns, embedding)][-window:]
    asked = rng.normal(size=(4, 5))
    got = memory.since(oldest_ns).similarity(asked)
    assert ((got >= -1) & (got <= 1) | np.isneginf(got)).all()
    for row, queue in enumerate(queues):
        for column, one in enumerate(asked):
            cosines = [one @ each / np.linalg.norm(one) / np.linalg.norm(each) for at, each in queue if at >= oldest_ns]
            assert got[row, column] == pytest.approx(max(cosines, default=-np.inf), abs=1e-5)


def test_wrong_shapes_are_refused() -> None:
    memory = remembering([EAST])
    with pytest.raises(InvalidValueError, match=r"embeddings must have shape \(N, 2\), got \(1, 3\)"):
        memory.similarity([[1.0, 2.0, 3.0]])
    with pytest.raises(InvalidValueError, match=r"embeddings must have shape \(1, 2\), got \(2, 2\)"):
        memory.update(np.array([0]), [EAST, EAST], 1)
