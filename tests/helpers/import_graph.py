"""The graph of the library's imports, by files and by rooms (folders), and its circles."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]

Graph = Mapping[str, set[str]]


def top_level_imports(tree: ast.Module) -> list[str]:
    """Return what a module imports when it is loaded: not in functions, and not for type checkers only."""
    names: list[str] = []
    stack: list[ast.stmt] = list(tree.body)
    while stack:
        node = stack.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            stack.extend(node.orelse)
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, (ast.If, ast.Try)):
            stack.extend(child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt))
    return names


def module_files() -> dict[str, Path]:
    """Return every module of the library, with its file."""
    files: dict[str, Path] = {}
    for folder, package in (("coopsim", "coopsim"), ("envs", "coopsim.envs"), ("agents", "coopsim.agents")):
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            if folder == "coopsim" and parts[0] in ("envs", "agents"):  # links
                continue
            files[".".join((package, *parts)).removesuffix(".__init__")] = path
    return files


@cache
def file_graph() -> dict[str, set[str]]:
    """Return which modules each module imports when it is loaded."""
    files = module_files()
    return {
        name: {_module(each, files) for each in top_level_imports(ast.parse(path.read_text()))} - {name, ""}
        for name, path in files.items()
    }


def _module(imported: str, files: Mapping[str, Path]) -> str:
    """Return the module of the library that is imported, itself or a name in it; "" for others."""
    return next((each for each in (imported, imported.rpartition(".")[0]) if each in files), "")


def room_graph(files: Graph) -> dict[str, set[str]]:
    """Return which rooms (folders next to each other under coopsim, and loose files) import which."""
    rooms: dict[str, set[str]] = {}
    for name, imported in files.items():
        rooms.setdefault(room(name), set()).update(room(each) for each in imported)
    return {name: imported - {name} for name, imported in rooms.items()}


def folder_graph(package: str, *, loose_apart: bool = False) -> dict[str, set[str]]:
    """Return which folders of a package import which.

    Loose files of the package are its own folder or, with `loose_apart`, a node each.
    """
    files = module_files()

    def folder(module: str) -> str:
        apart = loose_apart and module.count(".") == package.count(".") + 1
        return module if apart or files[module].name == "__init__.py" else module.rpartition(".")[0]

    start = f"{package}." if loose_apart else package
    folders: dict[str, set[str]] = {}
    for name, imported in file_graph().items():
        if name.startswith(start):
            inside = {folder(each) for each in imported if each.startswith(start)}
            folders.setdefault(folder(name), set()).update(inside - {folder(name)})
    return folders


def room(module: str) -> str:
    """Return the room of a module: `coopsim.comms` for `coopsim.comms.codecs.codec`."""
    return ".".join(module.split(".")[:2])


def circles(graph: Graph) -> list[list[str]]:
    """Return the groups of nodes that reach each other (Tarjan's strongly connected components of two or more)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in sorted(graph.get(node, ())):
            if other not in order:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == order[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in sorted(graph):
        if node not in order:
            visit(node)
    return found


def arrows(files: Graph, group: Iterable[str]) -> list[str]:
    """Return the file imports behind a circle of rooms, for the message of a failed test."""
    inside = set(group)
    return sorted(
        f"{name} -> {each}"
        for name, imported in files.items()
        for each in imported
        if room(name) != room(each) and {room(name), room(each)} <= inside
    )
