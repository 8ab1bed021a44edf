"""Objects from mappings and YAML files, by annotations: what they become, and where errors say that they are wrong."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pytest

from coopsim.config.load import load, read_mapping
from coopsim.config.yaml_file import read_yaml
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice, require_positive


class Shape:
    pass


@dataclass(frozen=True)
class Circle(Shape):
    radius_m: float = 1.0

    def __post_init__(self) -> None:
        require_positive(radius_m=self.radius_m)


@dataclass(frozen=True)
class Square(Shape):
    side_m: float
    color: str = "red"

    def __post_init__(self) -> None:
        require_choice("color", self.color, ("red", "blue"))


@dataclass(frozen=True)
class Drawing:
    shape: Shape | None = None
    round: Circle | Mapping[str, Circle] = field(default_factory=Circle)
    corners: Mapping[str, Square] = field(default_factory=dict)
    background: str | Square = "white"
    sizes: Mapping[str, float] = field(default_factory=dict)


MODELS = {Shape: {"circle": Circle, "square": Square}}


def draw(given: Any) -> Any:
    return load(Drawing, given, "drawing", MODELS)


@pytest.mark.parametrize(
    ("given", "made"),
    [
        ({}, Drawing()),
        (Drawing(Circle(2.0)), Drawing(Circle(2.0))),
        ({"shape": None}, Drawing()),
        ({"shape": {"model": "square", "side_m": 2.0}}, Drawing(Square(2.0))),
        ({"shape": Square(2.0)}, Drawing(Square(2.0))),
        ({"round": {"radius_m": 3.0}}, Drawing(round=Circle(3.0))),
        (
            {"round": {"cav_0": {"radius_m": 3.0}, "cav_1": Circle()}},
            Drawing(round={"cav_0": Circle(3), "cav_1": Circle()}),
        ),
        ({"round": {"ego": {}}}, Drawing(round={"ego": Circle()})),
        ({"corners": {"left": {"side_m": 1.0}}}, Drawing(corners={"left": Square(1.0)})),
        ({"background": "blue"}, Drawing(background="blue")),
        ({"background": {"side_m": 1.0}}, Drawing(background=Square(1.0))),
        ({"sizes": {"a": 1.0}}, Drawing(sizes={"a": 1.0})),
    ],
)
def test_annotations_say_what_data_becomes(given: Any, made: Drawing) -> None:
    assert draw(given) == made


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (3, InvalidValueError, "^drawing must be a mapping, got 3$"),
        ({"shap": 3}, UnknownNameError, "^unknown drawing option 'shap'. Did you mean 'shape'"),
        ({"shape": 3}, InvalidValueError, "^drawing shape must be a mapping, got 3"),
        (
            {"shape": {"side_m": 3}},
            InvalidValueError,
            "^drawing shape: model must be given, .* accepted: circle, square",
        ),
        ({"shape": {"model": "ring"}}, UnknownNameError, "^unknown drawing shape model 'ring'"),
        ({"shape": {"model": "square"}}, InvalidValueError, "^drawing shape: side_m must be given"),
        (
            {"round": {"radius": 1.0}},
            UnknownNameError,
            "^unknown drawing round option 'radius'. Did you mean 'radius_m'",
        ),
        ({"round": {"model": 1.0}}, InvalidValueError, "^drawing round of model must be a mapping"),
        ({"round": {"cav_0": {"radius_m": 0}}}, InvalidValueError, "^drawing round of cav_0: radius_m must be"),
        ({"corners": {"left": {"model": "square", "side_m": 1.0}}}, UnknownNameError, "corner left option 'model'"),
        (
            {"corners": {"left": {"side_m": 1, "color": "rde"}}},
            UnknownNameError,
            "^unknown drawing corner left color 'rde'",
        ),
        ({"round": {"radius_m": "1e3"}}, InvalidValueError, r"\('1e3' is a text in YAML: write it like"),
    ],
)
def test_errors_name_the_part(given: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        draw(given)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shape:\n  model: square\n  side: 1\n", ":3: unknown drawing shape option 'side'. Did you mean 'side_m'"),
        ("shape:\n  model: sqare\n", ":2: unknown drawing shape model 'sqare'. Did you mean 'square'"),
        ("shape:\n  color: red\n  model: square\n", ":1: drawing shape: side_m must be given"),
        ("\nround:\n  cav_0:\n    radius_m: -1\n", ":4: drawing round of cav_0: radius_m must be"),
        ("corners:\n  a: {side_m: 1}\n  b: 3\n", ":3: drawing corner b must be a mapping, got 3"),
        ("corners:\n  a: {side_m: 1}\n  a: {side_m: 1}\n", ":3: a is there twice"),
        ("corners: &x\n  a: *x\n", ":2: an alias is part of what it stands for"),
        ("shape: [\n", ":2: this is no YAML"),
        ("round: 2001-99-99\n", ":1: round cannot be read: month must be in 1..12"),
    ],
)
def test_errors_about_files_begin_with_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "drawing.yaml"
    path.write_text(text)
    with pytest.raises((InvalidValueError, UnknownNameError)) as caught:
        draw(read_mapping("drawing", "a Drawing", path))
    assert f"{path}{message}" in str(caught.value)


def test_merged_keys_are_defaults(tmp_path: Path) -> None:
    path = tmp_path / "drawing.yaml"
    path.write_text("corners:\n  a: &usual {side_m: 1, color: blue}\n  b: {side_m: 2, <<: *usual}\n")
    mapping = read_mapping("drawing", "a Drawing", path)
    assert draw(mapping) == Drawing(corners={"a": Square(1, "blue"), "b": Square(2, "blue")})
    assert pickle.loads(pickle.dumps(mapping)) == mapping  # options travel to other processes


def test_objects_of_files_have_plain_data(tmp_path: Path) -> None:
    path = tmp_path / "drawing.yaml"
    path.write_text("sizes: {a: 1.0}\n")
    assert asdict(draw(read_mapping("drawing", "a Drawing", path)))["sizes"] == {"a": 1.0}


@pytest.mark.parametrize("text", ["", "- 1\n", "3\n"])
def test_a_file_without_keys_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "drawing.yaml"
    path.write_text(text)
    with pytest.raises(InvalidValueError, match="drawing must be a Drawing, a mapping or the path of a YAML file, got"):
        read_mapping("drawing", "a Drawing", str(path))


def test_aliases_are_counted_before_they_are_expanded(tmp_path: Path) -> None:
    """Nine levels of ten aliases, 500 bytes, would be a billion values."""
    path = tmp_path / "bomb.yaml"
    levels = [f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 10)}]" for k in range(1, 10)]
    path.write_text("\n".join(["l0: &l0 [x]", *levels]))
    with pytest.raises(InvalidValueError, match=r"bomb\.yaml:1: aliases must stand for at most") as raised:
        read_yaml(path, InvalidValueError)
    assert len(str(raised.value)) < 300
    path.write_text("\n".join(["l0: &l0 [x]", *levels[:3]]))
    assert len(read_yaml(path, InvalidValueError).value["l3"]) == 10, "1,000 values are none too many"


def test_an_error_is_a_line_however_long_the_value() -> None:
    with pytest.raises(InvalidValueError) as raised:
        load(Drawing, ["x"] * 100_000, "drawing")
    assert len(str(raised.value)) < 5000 and "drawing must be a mapping, got ['x', " in str(raised.value)
    assert str(InvalidValueError("line\n" * 5000)) == "line\n" * 5000, "a traceback is kept"
