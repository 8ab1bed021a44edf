"""Whatever is wrong in an exported folder is found, with the file and the field."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import yaml

import coopsim
from coopsim.data.export.folder_checks import SUMS
from coopsim.errors import ExportError, UnknownNameError

YAML, PCD, PNG = (f"crossing_0000/-1/000000{end}" for end in (".yaml", ".pcd", "_camera0.png"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "whole"
    options = {"vehicles": 6, "rsus": 1, "lidar": "VLP-16", "lidar_columns": 64, "cameras": "front"}
    coopsim.export("opv2v", "crossing", folder, frames=2, renderer="raycast", **options)
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    shutil.copytree(whole, tmp_path / "copy")
    return tmp_path / "copy"


def _problems(folder: Path, **options) -> list[tuple[str, str]]:
    return [(problem.file, problem.field) for problem in coopsim.check_export(folder, **options)]


def _change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("lidar_pose: [", "lidar_pose: [1.0, ", "lidar_pose"),
        ("vehicles:\n", "vehicles: []\nothers:\n", "vehicles"),
        ("extent: [", "extent: [-", "vehicles.{}.extent"),
        ("location: [", "location: [x, ", "vehicles.{}.location"),
        ("  intrinsic: [[", "  intrinsic: [[[", ""),
        ("  intrinsic: ", "  k: ", "camera0.intrinsic"),
        ("  cords: [", "  cords: [0.0, ", "camera0.cords"),
        ("agent: rsu_0", "agent: !!python/object:os.system rsu_0", ""),
    ],
)
def test_a_wrong_field_is_named(folder, old, new, field):
    first = next(iter(yaml.safe_load((folder / YAML).read_text())["vehicles"]))
    _change(folder / YAML, old, new)
    *_, problem = coopsim.check_export(folder)
    assert problem.file == YAML and problem.reason.startswith(field.format(first))
    assert problem in list(coopsim.check_export(folder, "opv2v"))


@pytest.mark.parametrize("name", [YAML, PCD, PNG])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    assert _problems(folder)[0] == (name, "")


@pytest.mark.parametrize("name", [YAML, PCD, PNG])
def test_a_file_that_is_cut_off_is_named(folder, name):
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) // 2])
    assert {file for file, _ in _problems(folder)} == {name}
    ((file, _),) = _problems(folder, format="opv2v")
    assert file == name


def test_a_changed_number_is_found_by_the_checksum(folder):
    _change(folder / YAML, "lidar_pose: [", "lidar_pose: [1")
    assert _problems(folder) == [(YAML, "")]
    assert _problems(folder, format="opv2v") == []


@pytest.mark.parametrize("name", ["/etc/hostname", "../outside"])
def test_checksums_of_files_elsewhere_are_not_looked_at(folder, name):
    (folder.parent / "outside").write_text("x")
    with (folder / SUMS).open("a") as file:
        file.write(f"{'0' * 64}  {name}\n")
    ((file, _),) = _problems(folder)
    assert file == SUMS


def test_an_added_file_is_named(folder):
    (folder / "notes.txt").write_text("mine")
    assert _problems(folder) == [("notes.txt", "")]


def test_a_broken_card_is_named(folder):
    card = folder / "export.json"
    card.write_text("{")
    with pytest.raises(ExportError, match=r"export\.json"):
        coopsim.check_export(folder)
    card.write_text(json.dumps({"format": "opv2v", "seeds": 3}))
    with pytest.raises(ExportError, match="seeds must be a list"):
        coopsim.check_export(folder)


def test_what_is_no_export_is_refused(tmp_path):
    with pytest.raises(ExportError, match="there is no folder"):
        coopsim.check_export(tmp_path / "none")
    with pytest.raises(ExportError, match=r"has no export\.json"):
        coopsim.check_export(tmp_path)
    with pytest.raises(UnknownNameError, match="opv2v"):
        coopsim.check_export(tmp_path, "opv")
    (problem,) = coopsim.check_export(tmp_path, "opv2v")
    assert "has no recordings of format 'opv2v'" in problem.reason
