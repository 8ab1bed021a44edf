"""The map of the house names every room, has a row for everything that can be added, and shows the core's path."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

from import_graph import module_files

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "house.md").read_text()
ROWS = [line for line in PAGE.splitlines() if line.startswith("|")]
FILES = module_files()
GROUPS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["groups"]


def is_named(folder: Path) -> bool:
    """Return whether a row has a folder's path, or its name beside the path of a folder that it is in."""
    outer = [f"`{each.as_posix()}/`" for each in folder.parents if each != Path()]
    inner = [f"`{folder.relative_to(each).as_posix()}/`" for each in folder.parents if each != Path()]
    return any(
        f"`{folder.as_posix()}/`" in row
        or any(path in row and name in row for path, name in zip(outer, inner, strict=True))
        for row in ROWS
    )


def registries() -> dict[str, str | None]:
    """Return the names of all registries of the library, each with its entry-point group, if it has one."""
    found: dict[str, str | None] = {}
    for text in (path.read_text() for path in FILES.values()):
        for node in ast.parse(text).body if "Registry[" in text else ():
            match node:
                case ast.AnnAssign(ast.Name(name), ast.Subscript(ast.Name("Registry")), ast.Call(_, _, keywords)):
                    groups = [each.value for each in keywords if each.arg == "group"]
                    found[name] = ast.literal_eval(groups[0]) if groups else None
    return found


def test_every_room_is_named() -> None:
    folders = {path.parent.relative_to(ROOT) for path in FILES.values()} - {Path("coopsim")}
    assert len(folders) > 60
    assert sorted(folder.as_posix() for folder in folders if not is_named(folder)) == []


def test_every_registry_has_a_row_with_its_entry_points() -> None:
    known = registries()
    assert len(known) > 25
    for name, group in known.items():
        row = next((row for row in ROWS if f"`{name}`" in row), None)
        assert row is not None, f"{name} has no row"
        assert group is None or f"`{group}`" in row, f"{group} is not in the row of {name}"


def test_every_group_is_named_and_drawn() -> None:
    picture = (ROOT / "docs" / "reference" / "walls.svg").read_text()
    for group in GROUPS.keys() - {"names"}:  # three files of names, which the page describes in words
        assert any(row.startswith(f"| {group} |") for row in ROWS), group
        assert f">{group}</text>" in picture, group


def test_the_path_is_of_files_of_the_core() -> None:
    rows = PAGE.split("## The core's path")[1].split("\n## ")[0]
    files = re.findall(r"`([a-z0-9_/]+\.py)`", rows)
    assert len(files) == len(set(files)) > 35
    modules = {path.relative_to(ROOT).as_posix(): name for name, path in FILES.items()}
    for file in files:
        name = modules[file]
        entries = [entry for each in GROUPS.values() for entry in each if f"{name}.".startswith(f"{entry}.")]
        assert max(entries, key=len) in GROUPS["core"], file
