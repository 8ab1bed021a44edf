"""The command that draws the documentation's pictures: none is an orphan, and only what is asked for is drawn."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import draw_gallery
import pytest
from draw_gallery import DOCS, OTHERS, ROOT, STEPS

PICTURES = ("*.png", "*.jpg", "*.gif", "*.webp", "*.svg")


def test_every_picture_is_drawn_by_a_step_or_named_with_what_drew_it() -> None:
    there = {path.relative_to(DOCS).as_posix() for pattern in PICTURES for path in DOCS.rglob(pattern)}
    drawn: set[str] = set()
    for name, step in STEPS.items():
        for pattern in step.pictures:
            found = {path.relative_to(DOCS).as_posix() for path in DOCS.glob(pattern)}
            assert found, f"{name} draws {pattern}, which is not there"
            drawn |= found
    assert there - drawn == {*OTHERS}, "a picture needs a step in scripts/draw_gallery.py"


def test_every_picture_is_shown() -> None:
    pages = "\n".join(path.read_text(encoding="utf-8") for path in [*DOCS.rglob("*.md"), ROOT / "README.md"])
    pages += (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    shown = {Path(each).name for each in re.findall(r"[\w./-]+\.(?:png|jpg|gif|webp|svg)", pages)}
    there = {path.name for pattern in PICTURES for path in DOCS.rglob(pattern)}
    assert there <= shown


def test_commands_name_files_that_are_there() -> None:
    for step in STEPS.values():
        for command in step.commands:
            program, first, *_ = [word for word in shlex.split(command) if "=" not in word and word != "env"]
            if program == "python" and first != "-c":
                assert (ROOT / first).is_file(), command
            if program == "page":
                assert (DOCS / first).read_text(encoding="utf-8").count("```python") == 1, command


def test_only_what_is_asked_for_is_drawn(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    ran: list[str] = []
    draw_gallery.draw(["street", "message"], ran.append)
    assert len(ran) == 4 and "{tmp}" not in "".join(ran) and ran[-1] == "python scripts/draw_message.py"
    asked: list[str] = []
    monkeypatch.setattr(draw_gallery, "draw", lambda names: asked.extend(names))
    monkeypatch.delenv("COOPSIM_DATA", raising=False)
    draw_gallery.main(["--without", "towns"])
    assert "maps" not in asked and "towns" not in asked and "scenarios" in asked
    capsys.readouterr()
    draw_gallery.main(["--list"])
    listed = capsys.readouterr().out
    assert all(f"{name}: " in listed for name in [*STEPS, *OTHERS]) and len(asked) == len({*asked})


@pytest.mark.parametrize(("words", "told"), [(["nothing"], "unknown step"), (["maps"], "COOPSIM_DATA")])
def test_bad_input_gets_a_line(
    words: list[str], told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("COOPSIM_DATA", raising=False)
    with pytest.raises(SystemExit):
        draw_gallery.main(words)
    assert told in capsys.readouterr().err.splitlines()[-1]
