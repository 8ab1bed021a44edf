"""An export can be interrupted at any frame, goes on, and ends in the same bytes; a folder of others is left alone."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

import coopsim
from coopsim.data.export.export_card import CARD, ExportCard
from coopsim.data.export.folder_checks import SUMS, files_below
from coopsim.errors import ExportError, InvalidValueError, UnknownNameError

OPTIONS = {"vehicles": 6, "lidar": "VLP-16", "lidar_columns": 64}
SEEDS, FRAMES = (4, 0), 3


class _Stop(BaseException):
    """As Ctrl-C."""


def _export(folder: Path, stop_after: int | None = None, **changes) -> list[int]:
    """Export, but stop after some frames; return what was reported."""
    reports: list[int] = []

    def progress(count: int) -> None:
        reports.append(count)
        if stop_after is not None and len(reports) > stop_after:
            raise _Stop

    options = {"seeds": SEEDS, "frames": FRAMES, **OPTIONS, **changes}
    coopsim.export(options.pop("format", "opv2v"), "crossing", folder, progress=progress, **options)
    return reports


def _content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files_below(folder)}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "whole"
    _export(folder)
    return folder


@pytest.mark.parametrize("stop_after", [1, 4, 5])
def test_an_interrupted_export_goes_on_and_ends_in_the_same_bytes(whole, tmp_path, stop_after):
    with pytest.raises(_Stop):
        _export(tmp_path, stop_after)
    (problem,) = coopsim.check_export(tmp_path)
    assert (problem.file, problem.field) == (CARD, "state")
    (tmp_path / "crossing_0004" / "left.tmp").write_text("by a killed command")
    reports = _export(tmp_path)
    assert reports[0] == (FRAMES if stop_after > FRAMES else 0)  # a finished episode is not simulated again
    assert sum(reports) == FRAMES * len(SEEDS)
    assert _content(tmp_path) == _content(whole)


def test_a_finished_export_is_left_as_it_is(whole):
    before = {path: path.stat().st_mtime_ns for path in files_below(whole)}
    assert _export(whole) == [FRAMES * len(SEEDS)]
    assert {path: path.stat().st_mtime_ns for path in files_below(whole)} == before


def test_the_card_tells_what_is_there(whole):
    card, page = json.loads((whole / CARD).read_text()), (whole / "README.md").read_text()
    assert card["state"] == "done"
    assert card["seeds"] == list(SEEDS)
    assert card["options"] == OPTIONS
    assert card["versions"]["coopsim"] == coopsim.__version__
    assert card["files"] == len((whole / SUMS).read_text().splitlines()) == 1 + 2 * FRAMES * 4 * len(SEEDS)
    assert card["bytes"] == sum(
        path.stat().st_size for path in files_below(whole) if path.name not in (CARD, SUMS, "README.md")
    )
    assert "| environment | crossing |" in page
    assert "| seeds | 4, 0 |" in page


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"frames": 4}, "frames is 3 there, 4 here"),
        ({"seeds": (4, 1)}, r"seeds is \[4, 0\] there, \[4, 1\] here"),
        ({"vehicles": 7}, "options is"),
        ({"format": "opv2v(lidar=lidar)"}, "format is 'opv2v' there"),
    ],
)
def test_another_export_into_the_folder_is_refused_with_what_differs(whole, changes, told):
    before = _content(whole)
    with pytest.raises(ExportError, match=told):
        _export(whole, **changes)
    assert _content(whole) == before


def test_a_folder_that_holds_something_else_is_refused(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ExportError, match="must be new, empty"):
        _export(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_second_export_into_the_folder_waits_for_the_first(whole, tmp_path):
    """Both would write the same files in turns, and the first would call its export finished."""
    refused: list[str] = []

    def progress(count: int) -> None:
        if not refused:
            with pytest.raises(InvalidValueError, match=f"in use by process {os.getpid()}") as raised:
                _export(tmp_path)
            refused.append(str(raised.value))

    coopsim.export("opv2v", "crossing", tmp_path, seeds=SEEDS, frames=FRAMES, progress=progress, **OPTIONS)
    assert len(refused) == 1 and _content(tmp_path) == _content(whole)


def test_files_are_on_the_disk_before_the_card_says_that_they_are_there(tmp_path, monkeypatch):
    synced: set[str] = set()
    lacking: list[str] = []
    write = ExportCard.write

    def note(handle: int) -> None:
        synced.add(os.readlink(f"/proc/self/fd/{handle}"))

    def check(card: ExportCard) -> None:
        lacking.extend(str(path) for path in files_below(tmp_path) if str(path) not in synced and path.name != CARD)
        write(card)

    monkeypatch.setattr(os, "fsync", note)
    monkeypatch.setattr(ExportCard, "write", check)
    for format_ in ("opv2v", "kitti", "v2x-seq", "nuscenes"):
        coopsim.export(format_, "crossing", tmp_path / format_, seeds=(0,), frames=2, **OPTIONS)
    assert len(synced) > 20 and lacking == []


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    for folder in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(InvalidValueError, match=f"cannot make the folder {folder}: {tmp_path / 'out'} is a file"):
            _export(folder)
    with pytest.raises(InvalidValueError, match="folder must be a path, got None"):
        _export(None)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "out").mkdir(mode=0o500)
    with pytest.raises(InvalidValueError, match="cannot write"):
        _export(tmp_path / "out")


@pytest.mark.parametrize(
    ("changes", "error", "told"),
    [
        ({"format": "opv2"}, UnknownNameError, "Did you mean 'opv2v'"),
        ({"format": "opv2v(lidr=x)"}, UnknownNameError, "Did you mean 'lidar'"),
        ({"vehicels": 3}, UnknownNameError, "Did you mean 'vehicles'"),
        ({"frames": 0}, InvalidValueError, "frames must be an integer >= 1"),
        ({"seeds": (1, 1)}, InvalidValueError, "seeds must be distinct"),
        ({"seeds": 5}, InvalidValueError, "seeds must be a list of at least one, .* got 5"),
        ({"seeds": range(10**12)}, InvalidValueError, "seeds must be a list of at most 100,000"),
        ({"max_cycles": 3}, InvalidValueError, "max_cycles must be left out"),
        ({"detector": object()}, InvalidValueError, "options must be plain data"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_written(changes, error, told, tmp_path):
    with pytest.raises(error, match=told):
        _export(tmp_path / "out", **changes)
    assert not (tmp_path / "out").exists()


def test_frames_of_an_environment_hold_the_truth_so_they_need_its_consent():
    env = coopsim.parallel_env("crossing", vehicles=4, lidar=None)
    with pytest.raises(InvalidValueError, match="expose_ground_truth"):
        next(env.frames(0))
