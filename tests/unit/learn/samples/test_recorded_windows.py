"""Which recordings are trained on: never those of validation, nor those held out."""

from __future__ import annotations

from pathlib import Path

import pytest
from synthetic_recordings import write_recordings

from coopsim.errors import CoopsimError, InvalidValueError, RecordingError, UnknownNameError
from coopsim.learn.samples.windows import RecordedWindows, RecordedWorld

KNOWN = ("0000", "0001", "0026", "0027")


def test_validation_and_held_out_recordings_are_not_trained_on() -> None:
    world = RecordedWorld(held_out=("0026",))
    assert world.trained_on(KNOWN) == ("0001", "0027")
    with pytest.raises(InvalidValueError, match="without must have 0000, which V2V4Real validates on"):
        RecordedWorld(held_out=("0026",), without=()).trained_on(KNOWN)
    assert "0000" in RecordedWorld(held_out=(), without=(), allow_validation=True).trained_on(KNOWN)


def test_what_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown held_out '0031'"):
        RecordedWorld(held_out=("0031",)).trained_on(KNOWN)
    with pytest.raises(InvalidValueError, match="there must be a recording to train on"):
        RecordedWorld(held_out=("0001",)).trained_on(("0000", "0001"))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"path": 3}, "path must be the folder of a recording set, got 3"),
        ({"held_out": "0026"}, "held_out must be names"),
        ({"detections": []}, "detections must be at least one name"),
        ({"axes": "kity"}, "unknown axes 'kity'"),
        ({"frames": 1}, "frames must be an integer in"),
        ({"dt_s": 0}, "dt_s"),
        ({"allow_validation": 1}, "allow_validation must be"),
    ],
)
def test_wrong_values_are_refused(options: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        RecordedWorld(**options)  # type: ignore[arg-type]


def test_relative_paths_begin_at_the_folder_of_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_recordings(tmp_path / "mine")
    monkeypatch.setenv("COOPSIM_DATA", str(tmp_path))
    assert RecordedWorld("mine").folder().sequences == ("0001", "0002")
    with pytest.raises(RecordingError, match="no folder"):
        RecordedWorld("other").folder()
    monkeypatch.delenv("COOPSIM_DATA")
    with pytest.raises(InvalidValueError, match="COOPSIM_DATA"):
        RecordedWorld("mine").folder()


def test_windows_are_the_same_for_the_same_number(tmp_path: Path) -> None:
    world = RecordedWorld(str(write_recordings(tmp_path)), held_out=("0002",), frames=5)
    a, b = RecordedWindows(world, seed=1), RecordedWindows(world, seed=1)
    assert all((a.clip(k).numbers == b.clip(k).numbers).all() for k in range(3))
    assert len(a.clip(0).tracks.truth) == 5 and a.clip(0).numbers.shape == (5 * 2 * 4, 19)
    assert any((a.clip(k).numbers != a.clip(0).numbers).any() for k in range(1, 6))
