"""A file appears whole or not at all."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from coopsim.errors import InvalidValueError
from coopsim.support.files import LOCK, WrittenFiles, locked, require_writable, write_whole


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


def test_the_mask_of_the_process_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It can be read only by setting it, for a moment in all threads: others' files would be open to everybody."""
    monkeypatch.delattr(os, "umask")
    write_whole(tmp_path / "numbers", "x")


def test_an_interrupt_after_a_file_has_its_name_is_that_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = os.replace

    def replace_and_interrupt(old: str, new: str) -> None:
        replace(old, new)
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", replace_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "numbers", "new")
    assert (tmp_path / "numbers").read_text() == "new" and len(list(tmp_path.iterdir())) == 1


_HOLDER = """
import sys, time
from pathlib import Path
from coopsim.support.files import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_is_held_by_one_process_until_that_ends(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", _HOLDER, tmp_path], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        with pytest.raises(InvalidValueError, match=f"is in use by process {holder.pid} on ") as raised:
            locked(tmp_path).__enter__()
        assert str(raised.value).startswith(str(tmp_path))
        holder.kill()
        holder.wait()
    assert (tmp_path / LOCK).exists(), "it was killed"
    with locked(tmp_path), pytest.raises(InvalidValueError, match=f"in use by process {os.getpid()} on "):
        locked(tmp_path).__enter__()
    assert not list(tmp_path.iterdir())


def test_a_lock_does_not_lead_elsewhere(tmp_path: Path) -> None:
    victim = write_whole(tmp_path / "victim", "mine")
    folder = tmp_path / "theirs"
    folder.mkdir()
    (folder / LOCK).symlink_to(victim)
    with pytest.raises(InvalidValueError, match="cannot write"):
        locked(folder).__enter__()
    assert victim.read_text() == "mine"


def test_files_are_made_durable_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(os.readlink(f"/proc/self/fd/{handle}")))
    with WrittenFiles(tmp_path) as written:
        (tmp_path / "a").mkdir()
        files = [write_whole(tmp_path / name, "x") for name in ("a/one", "two")]
        assert synced == []
        written.sync()
        assert {str(path) for path in (*files, tmp_path, tmp_path / "a", tmp_path.parent)} == set(synced)
        written.sync()
        assert len(synced) == 6, "only the folder's own name again"
    write_whole(tmp_path / "three", "x")
    written.sync()
    assert len(synced) == 7
