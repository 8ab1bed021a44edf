"""The reference has an entry for every public name: each is a `:::` line of a page in docs/reference/api/."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
ENTRIES = [
    entry
    for page in sorted((ROOT / "docs" / "reference" / "api").glob("*.md"))
    for entry in re.findall(r"^::: (\S+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
]
PACKAGES = (
    "coopsim",
    "coopsim.agents",
    "coopsim.envs",
    "coopsim.envs.wrappers",
    "coopsim.metrics",
    "coopsim.nn.fusion",
    "coopsim.testing",
    "coopsim.types",
    "coopsim.world.models",
)


def resolve(entry: str) -> Any:
    """Return what a dotted name stands for, a module or something in one."""
    try:
        return importlib.import_module(entry)
    except ModuleNotFoundError:
        module, _, name = entry.rpartition(".")
        return getattr(importlib.import_module(module), name)


def documented() -> set[tuple[str, int]]:
    """Return name and identity of every entry; those of a module stand for all that it defines."""
    found = {(entry.rpartition(".")[2], id(resolve(entry))) for entry in ENTRIES}
    modules = [thing for thing in map(resolve, ENTRIES) if isinstance(thing, ModuleType)]
    return found | {(name, id(thing)) for module in modules for name, thing in vars(module).items()}


def exported(package: str) -> set[tuple[str, str]]:
    """Return the names that a package exports and that are no modules, each with the package."""
    home = importlib.import_module(package)
    names = {name for name in home.__all__ if not name.startswith("_")}
    return {(package, name) for name in names if not isinstance(getattr(home, name), ModuleType)}


def taught() -> set[tuple[str, str]]:
    """Return the names that pages and examples import from coopsim, each with its module."""
    codes = [path.read_text(encoding="utf-8") for path in sorted(ROOT.glob("examples/*.py"))]
    for page in (ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))):
        codes += re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    nodes = [node for code in codes for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)]
    return {(node.module or "", each.name) for node in nodes for each in node.names if is_ours(node.module or "")}


def is_ours(module: str) -> bool:
    return module.split(".")[0] == "coopsim"


def test_every_public_name_has_an_entry() -> None:
    pytest.importorskip("torch")
    public = taught().union(*map(exported, PACKAGES))
    known = documented()
    missing = [f"{module}.{name}" for module, name in public if (name, id(resolve(f"{module}.{name}"))) not in known]
    assert len(public) > 100
    assert sorted(missing) == []


def test_no_name_has_two_entries() -> None:
    assert sorted(ENTRIES) == sorted(set(ENTRIES))
