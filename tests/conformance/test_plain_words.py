"""Names are nouns of the field, and docstrings begin with what a thing does or is."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = sorted(
    path
    for path in (ROOT / "agents", ROOT / "envs", *(ROOT / "coopsim").iterdir())
    if path.is_dir() and path.name != "__pycache__" and not path.is_symlink()
)

HOMEMADE = (
    "believed", "crew", "doubt", "heard", "lining", "looks", "mast", "minds", "onboard", "sight",
    "soundness", "wishes",
)  # fmt: skip
"""Words that only their author reads, as a part of the name of a class, a function or a file."""

NO_BEGINNING = (
    "As", "By", "From", "How", "Nobody", "None", "Nothing", "Of", "One", "So", "That", "Those", "To", "What", "Where",
    "Whether", "Which", "Who", "Whom", "Whose",
)  # fmt: skip
"""A first sentence that begins with one of these lacks its noun or its verb."""

NO_NOUN = re.compile(
    r"\s+\*{0,2}\w+(?:, \w+)*: (?:as|by|how|of|so many|that|the same|those|what|which|who|whose|whom)\b"
)


def definitions(room: Path) -> Iterator[tuple[str, ast.AST]]:
    """Yield the place and the definition of every module, class and function of a room."""
    for path in sorted(room.rglob("*.py")):
        place = str(path.relative_to(ROOT))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                yield f"{place}:{getattr(node, 'lineno', 1)}", node


def words_of(name: str) -> list[str]:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().split("_")


@pytest.mark.parametrize("room", ROOMS, ids=[str(room.relative_to(ROOT)) for room in ROOMS])
def test_names_and_docstrings_are_plain(room: Path) -> None:
    wrong, seen = [], 0
    for place, node in definitions(room):
        seen += 1
        name = Path(place.partition(":")[0]).stem if isinstance(node, ast.Module) else node.name  # type: ignore[attr-defined]
        wrong += [f"{place}: {name} has {word!r}" for word in words_of(name) if word in HOMEMADE]
        text = ast.get_docstring(node, clean=False) or ""  # type: ignore[arg-type]
        first = re.match(r"\s*(\w+)", text)
        if first and first[1] in NO_BEGINNING:
            wrong.append(f"{place}: begins with {first[1]!r}: {text.strip().splitlines()[0]}")
        wrong += [f"{place}: {line.strip()}" for line in text.splitlines() if NO_NOUN.match(line)]
    assert seen and not wrong, f"{len(wrong)}:\n" + "\n".join(wrong)


@pytest.mark.parametrize(
    ("text", "plain"),
    [("    rank: process index", True), ("    rank: of the process", False), ("    a, b: what they hold", False)],
)
def test_arguments_have_nouns(text: str, plain: bool) -> None:
    assert (NO_NOUN.match(text) is None) == plain
