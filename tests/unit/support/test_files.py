"""A file appears whole or not at all."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable, write_whole


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


def test_a_link_is_followed_and_permissions_are_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    real.chmod(0o600)
    link.symlink_to(real)
    write_whole(link, "new")
    assert link.is_symlink() and real.read_text() == "new" and real.stat().st_mode & 0o777 == 0o600


def test_a_new_file_is_as_private_as_the_user_wants(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        assert write_whole(tmp_path / "numbers", "x").stat().st_mode & 0o777 == 0o600
    finally:
        os.umask(before)


def test_a_pipe_stays_a_pipe_and_its_reader_gets_the_text(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as pool:
        reader = pool.submit(pipe.read_text)
        require_writable(pipe)
        write_whole(pipe, "numbers")
        assert reader.result(timeout=10) == "numbers"
    assert pipe.is_fifo()


@pytest.mark.parametrize("name", ["", "missing/x", "file/x"])
def test_what_could_not_be_written_is_known_before(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    require_writable(tmp_path / "new")
    with pytest.raises(InvalidValueError, match="it must be a file in an existing, writable folder"):
        require_writable(tmp_path / name)
