"""Knowledge from messages alone, and the moment at which a message brings it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from some_films import some_film

from coopsim.bench.films.film import Film, FilmFrame, Place, to_rows
from coopsim.bench.films.recording import Recording
from coopsim.bench.films.told import tracked_ids, with_told
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.world.snapshot import RoadMap

ME, YOU, SEEN_BY_BOTH, SEEN_BY_YOU, SEEN_BY_NOBODY = 1, 2, 3, 5_000_000_000, 5
SHORT = SEEN_BY_YOU % 2**31  # as films have it
PLACES = {ME: (0, 0), YOU: (30, 0), SEEN_BY_BOTH: (10, 0), SEEN_BY_YOU: (20, 5), SEEN_BY_NOBODY: (50, 0)}
ON_NOTHING = (90, 90)


def rows(*places: tuple[float, float], ids: list[int] | None = None) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    return to_rows(np.array(ids or range(len(places))), np.array([[x, y, 4.5, 2.0, 0.5] for x, y in places]))


def film(*, arrives_in: int = 1, frames: int = 16) -> Film:
    """A film in which one message arrives; its receiver tracks all but itself, and something where nothing is."""
    truth = rows(*PLACES.values(), ids=list(PLACES))
    tracks = rows(*[(x + 0.4, y) for x, y in PLACES.values()][1:], ON_NOTHING)
    agents = {"me": Place(0, 0, True), "you": Place(30, 0, True)}
    shot = [FilmFrame(k * 100_000_000, agents, truth, tracks={"me": tracks}) for k in range(frames)]
    arrived = [{"me": frozenset({"you"})} if k == arrives_in else {} for k in range(frames + 1)]
    seen = [{"me": np.array([SEEN_BY_BOTH]), "you": np.array([SEEN_BY_BOTH, SEEN_BY_YOU])}] * frames
    told = with_told(shot, arrived, seen, {"me": ME, "you": YOU}, 0.1)
    return Film(0.1, RoadMap((), (), (), ()), told, arrived)


def test_what_a_sender_saw_or_is_and_the_receiver_does_not_see_is_known_by_message() -> None:
    told = [frame.told.get("me", np.zeros(0)).tolist() for frame in film().frames]
    assert told == [[], *[[YOU, SHORT]] * 11, [], [], [], []], "for a second after the message"


def test_news_are_new_for_a_moment() -> None:
    found = film()
    assert found.news("me", 0) == {} == found.news("you", 3)
    for frame in range(1, 9):
        assert found.news("me", frame) == pytest.approx(dict.fromkeys((YOU, SHORT), (frame - 1) / 8))
    assert found.news("me", 9) == {} == found.news("me", 12)
    assert set(film(arrives_in=0).news("me", 0).values()) == {0.0}, "before a film nothing was told"


def test_of_objects_beside_a_track_the_nearest_counts() -> None:
    truth = rows((0, 0), (3, 0), (40, 0), ids=[7, 8, 9])
    assert tracked_ids(truth, rows((2.2, 0), (-2.0, 0), (60, 0))).tolist() == [8, 7]
    assert len(tracked_ids(truth[:0], rows((0, 0)))) == 0 == len(tracked_ids(truth, truth[:0]))


def test_a_recording_places_news_where_the_object_is() -> None:
    shot = some_film(4)
    frames = [replace(frame, told={"cav_0": np.array([SHORT])} if k else {}) for k, frame in enumerate(shot.frames)]
    assert shot.drive is not None
    drive = replace(shot.drive, drive=replace(shot.drive.drive, ids=np.array([SEEN_BY_YOU])))
    recording = Recording.of(Cell("late_fusion", Condition(), 0, None), replace(shot, frames=frames, drive=drive))
    assert recording.at(0.0).news == []
    ((place, share),) = recording.at(0.2).news
    assert place.tolist() == [20.0, 0.0] and share == pytest.approx(1 / 8)
