"""What the documentation shows works: its Python runs, its YAML is accepted, its commands parse."""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fork_server import run_python
from representatives import all_of

import coopsim
from coopsim.cli.entry import make_parser
from coopsim.comms.channel.channel_config import channel_config
from coopsim.localization.localizer import localization_config

ROOT = Path(__file__).parents[2]
PROJECT_FILES = [ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob(".github/*.md"))]
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md")))
}

TRAINS = ("docs/learn/train_a_fusion.md", "18_train_your_own_fusion.py")
"""A page, and the example on it that takes too long here: CI runs it with all examples."""

IN_EVERY_RUN = ("README.md",)
"""Pages whose Python `make test` runs; `.ci/run` runs that of all others."""

MAY_LACK = {
    "stable_baselines3": "stable_baselines3",
    "supersuit": "supersuit",
    "torchrl": "torchrl.envs",
    "ray": "ray.rllib.algorithms.ppo",
    "moviepy": "moviepy",
}
"""Libraries that a page may show and a machine may lack, and what must be there of them. A block that imports one
stands by itself: it is left out where that is missing."""

EXAMPLES = (
    ("docs/learn/first_policy.md", "02_your_own_tracker.py"),
    ("docs/learn/first_metric.md", "08_your_own_metric.py"),
    ("docs/learn/first_place.md", "26_your_own_place.py"),
    ("docs/learn/first_detector.md", "09_your_own_detector.py"),
    ("docs/learn/first_detector.md", "10_your_own_embedder.py"),
    ("docs/learn/first_uplink.md", "11_your_own_uplink.py"),
    ("docs/learn/first_codec.md", "12_your_own_codec.py"),
    ("docs/learn/first_planner.md", "19_your_own_planner.py"),
    ("docs/learn/first_attack.md", "23_your_own_attack.py"),
    ("docs/learn/first_defense.md", "22_your_own_defense.py"),
    ("docs/learn/bring_your_network.md", "24_bring_your_network.py"),
    ("docs/reference/paste.md", "25_paste_into_sweeps.py"),
    TRAINS,
)
"""Pages that teach by an example; CI runs all examples."""


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[page], re.DOTALL | re.MULTILINE)


def imported(block: str) -> set[str]:
    """Top-level names of the modules that a block imports; gymnasium's `RecordVideo` imports MoviePy."""
    nodes = list(ast.walk(ast.parse(block)))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.split(".")[0] for name in names} | ({"moviepy"} if "RecordVideo" in block else set())


def lacks(block: str) -> bool:
    """Whether a library that the block imports is not installed; asked elsewhere, as some change much when loaded."""
    wanted = [MAY_LACK[name] for name in sorted(imported(block) & MAY_LACK.keys())]
    program = "; ".join(f"import {name}" for name in wanted)
    return (
        bool(wanted)
        and subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True).returncode != 0
    )


def _without_docstring(path: Path) -> str:
    code = path.read_text(encoding="utf-8")
    return "\n".join(code.splitlines()[ast.parse(code).body[0].end_lineno :]).strip()


def left_to_run(page: str) -> list[str]:
    """Return a page's Python, without examples on which nothing else on it builds: CI runs these with all examples."""
    shown = [block.strip() for block in blocks(page, "python")]
    examples = [_without_docstring(ROOT / "examples" / example) for there, example in EXAMPLES if there == page]
    if len(shown) > len(examples) and page != TRAINS[0]:
        return shown
    return [block for block in shown if block not in examples]


@pytest.mark.parametrize(
    "page", all_of((page for page in PAGES if left_to_run(page)), *(page for page in IN_EVERY_RUN if left_to_run(page)))
)
def test_python_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own where a page registers something, which would be there in all tests after it.

    So, too, where it imports a library that may be lacking: these warn of each other.
    """
    shown = left_to_run(page)
    code = "\n".join(["import coopsim", *(block for block in shown if not lacks(block))])
    monkeypatch.chdir(tmp_path)
    if any(imported(block) & MAY_LACK.keys() for block in shown):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    elif "register" in code:
        done = run_python(code, folder=tmp_path, found=tmp_path)
        assert done.returncode == 0, done.stderr
    else:
        exec(code, {"__name__": "__main__"})


@pytest.mark.parametrize(("page", "example"), EXAMPLES)
def test_page_shows_the_example(page: str, example: str) -> None:
    assert _without_docstring(ROOT / "examples" / example) in [block.strip() for block in blocks(page, "python")]


@pytest.mark.parametrize(
    ("page", "accept"),
    [
        ("docs/reference/scenarios.md", coopsim.parallel_env),
        ("docs/reference/channel.md", channel_config),
        ("docs/reference/localization.md", localization_config),
    ],
)
def test_yaml_is_accepted(page: str, accept: Callable[[Path], Any], tmp_path: Path) -> None:
    shown = blocks(page, "yaml")
    assert shown
    for number, block in enumerate(shown):
        path = tmp_path / f"{number}.yaml"
        path.write_text(block)
        assert accept(path) is not None


def test_commands_parse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of policies, as mine.py:MyTracker, are read for it: they are there."""
    monkeypatch.chdir(tmp_path)
    shown = [line for page in PAGES for block in blocks(page, "sh") for line in block.replace("\\\n", "").splitlines()]
    shown += [code for text in PAGES.values() for code in re.findall(r"`(coopsim [a-z]+ [^`]*--[^`]*)`", text)]
    commands = [words[1:] for words in (shlex.split(line, comments=True) for line in shown) if words[:1] == ["coopsim"]]
    assert {words[0] for words in commands} >= {"demo", "bench", "compare", "replay", "leaderboard", "record"}
    for words in commands:
        for file, policy in re.findall(r"(\w+\.py):(\w+)", " ".join(words)):
            Path(file).write_text(f"from coopsim.agents.boxes import AB3DMOTTracking as {policy}\n")
        make_parser().parse_args(words)


def test_links_lead_somewhere() -> None:
    broken = []
    for page in (*(ROOT / page for page in PAGES), *PROJECT_FILES):
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            path, _, anchor = target.partition("#")
            if "://" in target:
                continue
            file = page if not path else (page.parent / path)
            headings = (
                re.findall(r"^#+ (.*)$", file.read_text(), re.MULTILINE)
                if file.suffix == ".md" and file.exists()
                else []
            )
            anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            if not file.exists() or (anchor and anchor not in anchors):
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert not broken


MOST_COLUMNS = 100


def test_lines_are_short() -> None:
    """Prose is wrapped; tables and blocks of code are not prose."""
    long = []
    for page in (*(ROOT / page for page in PAGES), *PROJECT_FILES):
        in_code = False
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
            fence = line.lstrip().startswith("```")
            in_code ^= fence
            if len(line) > MOST_COLUMNS and not (in_code or fence or line.lstrip().startswith("|")):
                long.append(f"{page.relative_to(ROOT)}:{number}: {len(line)} characters")
    assert not long


def test_files_that_pages_name_exist() -> None:
    named = {
        (page, file)
        for page, text in PAGES.items()
        for file in re.findall(r"`((?:coopsim|envs|agents|tests|scripts|examples|docs)/[\w/]+\.\w+)`", text)
    }
    assert named
    assert not [f"{page}: {file}" for page, file in sorted(named) if not (ROOT / file).exists()]


def test_files_that_pages_name_without_a_folder_exist() -> None:
    """Except `mine.py`, which stands for a user's own."""
    rooms = ("coopsim", "envs", "agents", "tests", "scripts", "examples")
    files = {path.name for room in rooms for path in (ROOT / room).rglob("*.py")} | {"mine.py"}
    named = {(page, file) for page, text in PAGES.items() for file in re.findall(r"`(\w+\.py)`", text)}
    assert named and not [f"{page}: {file}" for page, file in sorted(named) if file not in files]


def test_the_notebook_is_stored_without_what_it_printed() -> None:
    cells = json.loads((ROOT / "examples" / "walkthrough.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert not [cell for cell in code if cell["outputs"] or cell["execution_count"]]
