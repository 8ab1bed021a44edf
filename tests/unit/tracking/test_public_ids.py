"""Ids that stay with the object, whoever tracks it, and a memory that does not grow."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from coopsim.tracking.track_ids import ABSENT, PublicIds

MEMORY_NS = 1_000


def assign(ids: PublicIds, now_ns: int, *members: tuple[int, ...]) -> list[int]:
    names = ("", "cav_1", "rsu_0")
    return ids.assign(names, np.array(members, dtype=np.int64).reshape(-1, 3), now_ns).tolist()


def test_an_object_keeps_its_id_from_hand_to_hand() -> None:
    ids = PublicIds(MEMORY_NS)
    assert assign(ids, 0, (ABSENT, 7, ABSENT)) == [1]
    assert assign(ids, 1, (4, 7, ABSENT)) == [1]
    assert assign(ids, 2, (4, ABSENT, ABSENT)) == [1]
    assert assign(ids, 3, (4, ABSENT, 9)) == [1]
    assert assign(ids, 4, (ABSENT, ABSENT, 9)) == [1]


def test_the_same_number_of_two_agents_is_two_objects() -> None:
    assert assign(PublicIds(MEMORY_NS), 0, (5, ABSENT, ABSENT), (ABSENT, 5, ABSENT), (ABSENT, ABSENT, 5)) == [1, 2, 3]


def test_objects_that_turn_out_to_be_one_go_on_under_the_oldest_id() -> None:
    ids = PublicIds(MEMORY_NS)
    assert assign(ids, 0, (1, ABSENT, ABSENT), (ABSENT, 1, ABSENT)) == [1, 2]
    assert assign(ids, 1, (1, 1, ABSENT)) == [1]
    assert assign(ids, 2, (ABSENT, 1, ABSENT)) == [1]


def test_an_object_that_turns_out_to_be_two_keeps_its_id_once() -> None:
    ids = PublicIds(MEMORY_NS)
    assert assign(ids, 0, (1, 1, ABSENT)) == [1]
    assert assign(ids, 1, (1, ABSENT, ABSENT), (ABSENT, 1, ABSENT)) == [1, 2]
    assert assign(ids, 2, (ABSENT, 1, ABSENT), (1, ABSENT, ABSENT)) == [2, 1]


def test_what_was_away_longer_than_the_memory_is_new() -> None:
    ids = PublicIds(MEMORY_NS)
    assert assign(ids, 0, (1, ABSENT, ABSENT)) == [1]
    assert assign(ids, MEMORY_NS, (1, ABSENT, ABSENT)) == [1]
    assert assign(ids, 2 * MEMORY_NS + 1, (1, ABSENT, ABSENT)) == [2]


def test_ids_are_unique_never_handed_on_and_forgotten_over_many_frames() -> None:
    """Random groups: an id is new, or one that a member of the group was reported under before."""
    rng = np.random.default_rng(0)
    ids, names_of, used = PublicIds(MEMORY_NS), defaultdict[tuple[int, int], set[int]](set), set[int]()
    for now_ns in range(0, 60_000, 100):
        count = int(rng.integers(0, 8))
        columns = [rng.permutation(12)[:count] + now_ns // 5_000 for _ in range(3)]
        members = np.where(rng.random((count, 3)) < 0.6, np.column_stack(columns), ABSENT)
        members = members[(members != ABSENT).any(axis=1)]
        public = assign(ids, now_ns, *map(tuple, members.tolist()))
        assert len(set(public)) == len(public)
        groups = [{(agent, local) for agent, local in enumerate(row) if local != ABSENT} for row in members.tolist()]
        for keys, name in zip(groups, public, strict=True):
            assert name not in used or any(name in names_of[key] for key in keys)
        for keys, name in zip(groups, public, strict=True):
            for key in keys:
                names_of[key].add(name)
        used |= set(public)
        assert len(ids) <= 3 * 14  # of those that were there within the memory, not of all that ever were
    assert len(names_of) > 60 and used == set(range(1, max(used) + 1))


def test_agents_that_change_their_names_for_ever_are_forgotten() -> None:
    ids = PublicIds(MEMORY_NS)
    for k in range(200):
        one, other = ids.assign(["", f"cav_{k}"], np.array([[3, ABSENT], [ABSENT, 3]]), k * 100).tolist()
        assert one == 1 and other == k + 2
    assert len(ids._agents) <= 2 + MEMORY_NS // 100


def test_nothing_to_name() -> None:
    ids = PublicIds(MEMORY_NS)
    assert assign(ids, 0) == [] and ids.assign([""], np.zeros((0, 1), dtype=np.int64), 1).tolist() == []
