"""The contract of import-linter that keeps the groups of the library apart."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from grimp import ImportGraph
from walls import Walls

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
GROUPS = {"core": ["lib.core", "lib.places.__init__"], "towns": ["lib.places.towns"], "names": ["lib.__init__"]}


def faults(*imports: tuple[str, str], groups: dict[str, Any] = GROUPS, ignored: tuple[str, ...] = ()) -> list[str]:
    """Check a graph of five modules with these imports."""
    graph = ImportGraph()
    for name in ("lib", "lib.core", "lib.core.step", "lib.places", "lib.places.towns"):
        graph.add_module(name)
    for importer, imported in imports:
        graph.add_import(importer=importer, imported=imported, line_number=7, line_contents="")
    options = {"groups": groups, "may_import": {"towns": ["core"]}, "ignore_imports": list(ignored)}
    checked = Walls("walls", {}, options).check(graph, verbose=False)
    assert checked.kept == (not checked.metadata["faults"])
    return list(checked.metadata["faults"])


def test_a_group_imports_itself_and_what_its_row_allows() -> None:
    assert faults(("lib.core.step", "lib.core"), ("lib.places.towns", "lib.core.step")) == []
    assert faults(("lib.core.step", "lib.places.towns")) == ["lib.core.step:7 (core) imports lib.places.towns (towns)"]


def test_the_longest_package_decides_and_a_packages_own_file_may_be_of_another_group() -> None:
    assert faults(("lib.places", "lib.places.towns")) == ["lib.places:7 (core) imports lib.places.towns (towns)"]
    assert faults(("lib.core.step", "lib")) == ["lib.core.step:7 (core) imports lib (names)"]


def test_every_module_is_in_a_group_and_every_entry_holds_one() -> None:
    assert faults(groups={**GROUPS, "towns": ["lib.villages"]}) == [
        "lib.places.towns is in no group",
        "lib.villages (towns) holds no module",
    ]


def test_an_exemption_that_is_not_needed_is_an_error() -> None:
    crossing = ("lib.core.step", "lib.places.towns")
    assert faults(crossing, ignored=(" -> ".join(crossing),)) == []
    with pytest.raises(Exception, match="No matches for ignored import"):
        faults(ignored=(" -> ".join(crossing),))


def test_every_exemption_has_a_reason_beside_it() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    listed = re.search(r"ignore_imports = \[\n(.*?)\n\]", text, re.DOTALL)
    assert listed is not None
    assert listed[1].split("\n")[0].strip().startswith("#")


def test_no_entry_is_in_two_groups() -> None:
    groups = PYPROJECT["tool"]["importlinter"]["contracts"][0]["groups"]
    entries = [entry for each in groups.values() for entry in each]
    assert sorted(entries) == sorted(set(entries))
