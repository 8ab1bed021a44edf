from __future__ import annotations

from helpers.clip_sources import NumberedClips

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_worker import make


def test_errors_of_sources_are_results() -> None:
    assert isinstance(make(NumberedClips(), 3), Clip)
    error = make(NumberedClips(fails_at=3), 3)
    assert isinstance(error, InvalidValueError) and "no clip 3" in str(error)
    report = make(NumberedClips(fails_at=3, why="other"), 3)
    assert isinstance(report, str) and "ZeroDivisionError" in report
