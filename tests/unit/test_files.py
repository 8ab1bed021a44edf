"""A file appears whole or not at all."""

from pathlib import Path

import pytest

from coopsim.errors import InvalidValueError
from coopsim.files import write_whole


def test_what_is_written_replaces_what_was(tmp_path: Path) -> None:
    target = tmp_path / "numbers.json"
    for text in ("old and longer", "new: é"):
        assert write_whole(target, text) == target
        assert target.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_half_way_keeps_the_old_file_and_leaves_no_litter(tmp_path: Path) -> None:
    target = write_whole(tmp_path / "numbers.json", "old")
    with pytest.raises(UnicodeEncodeError):
        write_whole(target, "new \ud800")  # a lone surrogate is no UTF-8
    assert target.read_text() == "old" and list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("name", ["", "missing/numbers.json"])
def test_where_nothing_can_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidValueError, match="cannot write"):
        write_whole(tmp_path / name, "text")
    assert list(tmp_path.iterdir()) == []
