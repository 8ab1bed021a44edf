"""Replaying a recording set: what it accepts, and how often it reads a file."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.data import kitti, recording_set
from coopsim.errors import InvalidValueError, RecordingError, UnknownNameError


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each file was read, by `folder/sequence`."""
    counted: Counter[str] = Counter()

    def counting(read: Any) -> Any:
        def count(path: Path, axes: str) -> Any:
            counted[f"{path.parent.name}/{path.stem}"] += 1
            return read(path, axes)

        return count

    monkeypatch.setattr(recording_set, "read_labels", counting(kitti.read_labels))
    monkeypatch.setattr(recording_set, "read_detections", counting(kitti.read_detections))
    return counted


@pytest.mark.parametrize(
    ("detections", "error", "match"),
    [
        (None, InvalidValueError, "detections must be a sequence of names, got None; accepted: 1, ego"),
        ({"ego"}, InvalidValueError, "detections must be a sequence of names, got {'ego'}; accepted: 1, ego"),
        ((), InvalidValueError, r"detections must be at least one name, got \(\); accepted: 1, ego"),
        (("ego", "1", "ego"), InvalidValueError, "detections must be different names, got 'ego' more than once"),
        ("eggo", UnknownNameError, "unknown detections 'eggo' in .* Did you mean 'ego'"),
        ("", UnknownNameError, "unknown detections '' in .*Accepted: 1, ego"),
        ((1,), UnknownNameError, "unknown detections 1 in .*Accepted: 1, ego"),
    ],
)
def test_bad_detections(recordings: Path, detections: Any, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("replay", path=recordings, detections=detections)
    with pytest.raises(error, match=match):
        coopsim.evaluate_recordings("no_fusion", recordings, detections)


@pytest.mark.parametrize("options", [{}, {"path": None, "detections": ("ego",)}, {"detections": ("ego",)}])
def test_a_missing_path_is_named(options: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match="path must be the folder of a recording set, got None"):
        coopsim.parallel_env("replay", **options)


def test_missing_detections_are_named(recordings: Path) -> None:
    with pytest.raises(InvalidValueError, match="detections must be a sequence of names, got None; accepted: 1, ego"):
        coopsim.parallel_env("replay", path=recordings)


def test_a_bare_name_is_one_agent(recordings: Path) -> None:
    assert coopsim.parallel_env("replay", path=recordings, detections="ego").possible_agents == ["ego"]
    assert list(coopsim.evaluate_recordings("no_fusion", recordings, "ego").count.agents) == ["ego"]


def test_an_empty_label_file_among_others_is_named(recordings: Path) -> None:
    (recordings / "labels" / "0001.txt").write_text("")
    with pytest.raises(RecordingError, match=r"labels/0001.txt is empty"):
        coopsim.parallel_env("replay", path=recordings, detections="ego")


def test_a_set_without_objects_can_be_played(recordings: Path) -> None:
    for sequence in ("0000", "0001"):
        (recordings / "labels" / f"{sequence}.txt").write_text("3 -1 DontCare" + " -1" * 14)
    assert coopsim.parallel_env("replay", path=recordings, detections="ego").state_space.shape == (0, 11)
    score = coopsim.evaluate_recordings("no_fusion", recordings, "ego").count.all_tracks
    assert (score["GT"], score["FN"]) == (0, 0)
    assert score["FP"] > 0


def test_the_first_sequence_is_read_when_it_is_played(recordings: Path, reads: Counter[str]) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"))
    assert reads == {"labels/0000": 1, "labels/0001": 1}
    reads.clear()
    env.reset(seed=0, options={"sequence": "0001"})
    assert reads == {"labels/0001": 1, "ego/0001": 1, "1/0001": 1}


def test_an_evaluation_reads_detections_once(recordings: Path, reads: Counter[str]) -> None:
    coopsim.evaluate_recordings("no_fusion", recordings, ("ego", "1"))
    labels = {"labels/0000": 2, "labels/0001": 2}  # for the size of the state, and to play
    assert reads == labels | {"ego/0000": 1, "ego/0001": 1, "1/0000": 1, "1/0001": 1}


def test_an_evaluation_lists_the_set_once(recordings: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed: list[object] = []
    make = recording_set.RecordingSet.__init__
    monkeypatch.setattr(
        recording_set.RecordingSet,
        "__init__",
        lambda self, path, axes: (listed.append(path), make(self, path, axes))[1],
    )
    assert coopsim.evaluate_recordings("no_fusion", recordings, "ego").frames == 10
    assert listed == [recordings]


def test_which_sequences_there_are(recordings: Path, make_small: Any) -> None:
    assert coopsim.parallel_env("replay", path=recordings, detections="ego").sequences == ("0000", "0001")
    assert make_small().sequences == ()


def test_an_unknown_sequence_leaves_the_running_episode(recordings: Path) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections="ego")
    env.reset(seed=0)
    with pytest.raises(UnknownNameError, match=r"unknown sequence '002'.*Accepted: 0000, 0001"):
        env.reset(seed=0, options={"sequence": "002"})
    assert env.agents == ["ego"]


def test_the_first_agent_owns_the_frame_for_all(recordings: Path) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"))
    assert [spec.frame_owner for spec in env.agent_specs.values()] == ["ego", "ego"]
