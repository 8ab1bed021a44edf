"""Lines as SUMO writes them are read as tables, and give what the reader of XML gives; others are left to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import log_files
import numpy as np
import pytest

from coopsim.data.logs import floating_cars, floating_lines
from coopsim.data.logs.floating_lines import regular_rows
from coopsim.data.logs.reading import read_log
from coopsim.errors import LogFileError

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<!-- made by SUMO -->\n<fcd-export version="1.2">\n'
STEPS, CARS = 40, 50


def _car(step: int, car: int) -> str:
    return (
        f'        <vehicle id="car {car}" x="{10 * car}.25" y="{step}.10" angle="0.00" type="bus_{car % 3}" '
        f'speed="10.00" pos="5.10" lane="1_0" slope="0.00"/>\n'
    )


def _person(step: int) -> str:
    return f'        <person id="a" x="-5.5" y="{step}" angle="0.00" speed="1.00" pos="5.10" edge="e" slope="0.00"/>\n'


def _text() -> str:
    steps = ['    <timestep time="0.00"/>\n']
    for step in range(1, STEPS + 1):
        lines = "".join(_car(step, car) for car in range(CARS)) + (_person(step) if step % 2 else "")
        steps.append(f'    <timestep time="{step / 10:.2f}">\n{lines}    </timestep>\n')
    return HEAD + "".join(steps) + "</fcd-export>\n"


@pytest.fixture(scope="module")
def text() -> str:
    return _text()


def _element_by_element(path: Path, monkeypatch: pytest.MonkeyPatch) -> floating_lines.FloatingRows:
    monkeypatch.setattr(floating_cars, "regular_rows", lambda path: None)
    return floating_cars._rows(path)


@pytest.mark.parametrize("block_bytes", [900, 1 << 24])
def test_regular_file_gives_what_xml_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, block_bytes: int
) -> None:
    monkeypatch.setattr(floating_lines, "BLOCK_BYTES", block_bytes)
    path = log_files.write_gzip(tmp_path / "a.fcd.xml.gz", text)
    rows, expected = regular_rows(path), _element_by_element(path, monkeypatch)
    assert rows is not None
    assert [rows.names[k] for k in rows.name] == [expected.names[k] for k in expected.name]
    assert [rows.types[k] for k in rows.type] == [expected.types[k] for k in expected.type]
    np.testing.assert_array_equal(rows.numbers, expected.numbers)


def test_regular_file_makes_no_element_of_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    (tmp_path / "a.fcd.xml").write_text(text)
    made: list[str] = []

    def count(file: str, *parts: bytes) -> list[tuple[str, dict[str, str]]]:
        found = original(file, *parts)
        made.extend(tag for tag, _ in found)
        return found

    def refuse(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
        raise AssertionError("elements were made of all rows")

    original = floating_lines.starts_of
    monkeypatch.setattr(floating_lines, "starts_of", count)
    monkeypatch.setattr(floating_cars, "read_starts", refuse)
    log = read_log(tmp_path / "a.fcd.xml")
    assert (len(log.ids), len(log.time_s)) == (CARS + 1, STEPS * CARS + STEPS // 2)
    assert made == ["fcd-export"]


IRREGULAR = {
    "entity": ('id="car 7"', 'id="car &amp; 7"'),
    "single quotes": ('pos="5.10"', "pos='5.10'"),
    "another order": ('angle="0.00" type="bus_1"', 'type="bus_1" angle="0.00"'),
    "another attribute more": ('slope="0.00"/>', 'slope="0.00" signals="0"/>'),
    "one attribute less": (' lane="1_0"', ""),
    "comment": ("    </timestep>", "<!-- here -->    </timestep>"),
    "two in a line": ("/>\n        <vehicle", "/>        <vehicle"),
    "letters": ('id="car 7"', 'id="Straße"'),
    "exponent": ('time="0.10"', 'time="1e-1"'),
    "vehicle after person": (_person(1), _person(1) + _car(1, 99)),
}


@pytest.mark.parametrize("change", IRREGULAR.values(), ids=IRREGULAR)
def test_irregular_file_is_read_as_xml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, change: tuple[str, str]
) -> None:
    before, after = change
    assert before in text
    path = tmp_path / "a.fcd.xml"
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    assert regular_rows(path) is None
    log = read_log(path)
    assert len(log.time_s) == len(_element_by_element(path, monkeypatch).name)


DAMAGED = {
    "cut off": (lambda text: text[:-4000]),
    "no end": (lambda text: text.replace("</fcd-export>", "")),
    "word": (lambda text: text.replace('x="70.25"', 'x="far"', 1)),
    "empty": (lambda text: text.replace('x="70.25"', 'x=""', 1)),
    "stray bracket": (lambda text: text.replace('id="car 7"', 'id="car <7"', 1)),
    "twice": (lambda text: text.replace('slope="0.00"', 'x="1"')),
    "entity of its own": (lambda text: text.replace("<fcd-export", '<!DOCTYPE a [<!ENTITY b "c">]><fcd-export')),
    "other root": (lambda text: text.replace("fcd-export", "net")),
    "no angle": (lambda text: text.replace(' angle="0.00"', "")),
    "no time": (lambda text: text.replace('time="1.00"', "")),
}


@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED)
def test_damaged_file_is_left_to_the_reader_of_xml(tmp_path: Path, text: str, damage: Callable[[str], str]) -> None:
    path = tmp_path / "a.fcd.xml"
    path.write_text(damage(text))
    assert regular_rows(path) is None
    with pytest.raises(LogFileError):
        read_log(path)


def test_gzip_that_is_cut_off_is_refused(tmp_path: Path, text: str) -> None:
    path = log_files.write_gzip(tmp_path / "a.fcd.xml.gz", text)
    path.write_bytes(path.read_bytes()[:-20])
    assert regular_rows(path) is None
    with pytest.raises(LogFileError, match="damaged or cut off"):
        read_log(path)
