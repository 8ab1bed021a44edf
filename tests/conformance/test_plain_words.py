"""Names are nouns of the field, docstrings begin with what a thing does or is, and prose is plain."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from coopsim.cli.entry import make_parser

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


PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]

MOST_WORDS = 30
"""Words of a sentence; code, a formula and a link count as one each."""

BANNED = {
    r"masts?": "roadside unit",
    r"nought": "zero",
    r"but for": "except",
    r"in the place of": "instead of",
    r"comes? along": "ships",
    r"mended": "repaired",
    r"named places": "built-in scenarios",
    r"surest": "most confident",
    r"hears?|heard": "receives",
    r"taught": "trained, supervised",
    r"half width": "half the width",
    r"at the moment of": "when",
    r"so many (?!that)": "this number of",
    r"looks(?! (?:\w+ ){0,2}(?:ahead|alike|along|at|down|for|like|up)\b)": "appearance",
    r"(?<=, )as CODE(?=[.,;:)])": "such as",
}
"""Words that a native of the field does not use so, and the usual ones."""


def without_code(text: str) -> str:
    text = re.sub(r"<!--.*?-->|^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`]*`|\$[^$]+\$", "CODE", re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text))


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a page's paragraphs and lists; tables, headings and code have none."""
    lines = [line.strip() for line in without_code(text).splitlines()]
    prose = ("" if line.startswith(("|", "#", "<", ":::", "$$")) else line for line in lines)
    for paragraph in re.split(r"\n(?=(?:[-*+]|\d+\.) )|\n\n", "\n".join(prose)):
        yield from re.split(r"(?<=[.!?])(?<!\bal\.)(?<!e\.g\.)(?<!i\.e\.)[\"')*]*\s+", " ".join(paragraph.split()))


def faults(text: str) -> list[str]:
    """Return what is not plain in a text: long sentences and banned words."""
    long = [s for s in sentences(text) if sum(bool(re.search(r"\w", word)) for word in s.split()) > MOST_WORDS]
    words = " ".join(without_code(text).split())
    return [f"over {MOST_WORDS} words: {sentence}" for sentence in long] + [
        f"{found[0]!r}: {usual} ({words[max(0, found.start() - 30) : found.end() + 30]})"
        for banned, usual in BANNED.items()
        for found in re.finditer(rf"(?<![\w-])(?:{banned})(?![\w-])", words, re.IGNORECASE)
    ]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_pages_are_plain(page: Path) -> None:
    wrong = faults(page.read_text(encoding="utf-8"))
    assert not wrong, f"{len(wrong)}:\n" + "\n".join(wrong)


def helps(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Yield the place and the text of every help of a command and of its own commands."""
    yield parser.prog, parser.description or ""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from helps(child)
        elif action.help not in (None, argparse.SUPPRESS):
            yield f"{parser.prog} {'/'.join(action.option_strings) or action.dest}", action.help or ""


def test_helps_are_plain() -> None:
    found = list(helps(make_parser()))
    assert len(found) > 100
    assert not [f"{place}: {fault}" for place, text in found for fault in faults(text)]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("A car sees a mast.", ["mast"]),
        ("A car looks at a mast-like thing, and it looks 3 s ahead.", []),
        ("The looks of a car differ. `mast` is code.\n\n```sh\nmast\n```", ["looks"]),
        ("One of many words, as `code`.", ["as CODE"]),
        (" ".join(["word"] * 31) + ".", ["over"]),
        (" ".join(["word"] * 20) + ". " + " ".join(["word"] * 20), []),
        (" ".join(["word"] * 20) + " et al. " + " ".join(["word"] * 20), ["over"]),
        ("- " + "word " * 20 + "\n- " + "word " * 20, []),
        ("| " + "word " * 40 + "|", []),
    ],
)
def test_faults_are_found(text: str, wrong: list[str]) -> None:
    found = [fault.lstrip("'") for fault in faults(text)]
    assert len(found) == len(wrong) and all(map(str.startswith, found, wrong))


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
