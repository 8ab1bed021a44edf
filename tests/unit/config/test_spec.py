"""Parameters of specs: what needs no quotes, and that a spelling is read as what was spelled."""

from __future__ import annotations

import pytest

from coopsim.config.spec import parse_spec, spell_spec
from coopsim.errors import InvalidValueError

PATHS = (
    "/some/path.safetensors",
    "gated/gated.safetensors",
    "my-weights_2.safetensors",
    "~/runs/a-1/x.yaml",
    "./x",
    "../a.b/c",
    "2026/05-run/w.npz",
    "für/alle.yaml",
    "1e5/x",
    "-a/b",
)
NO_PATHS = (
    "a b/c.x",
    "a,b/c",
    "it's/x",
    'x"/y',
    "a(b)/c",
    "1/2",
    "0.5m",
    "a-b",
    "C:/x",
    "",
    "class",
    "True",
    "true",
    "1",
    "nan.5",
)


@pytest.mark.parametrize("path", PATHS)
def test_a_path_needs_no_quotes(path: str) -> None:
    wanted = {"weights": path}
    assert parse_spec("x", f"pillars(weights={path})") == ("pillars", wanted)
    assert parse_spec("x", f"pillars( weights = '{path}' )") == ("pillars", wanted)
    assert spell_spec("pillars", wanted) == f"pillars(weights={path})"
    assert parse_spec("x", f"a(b=[1, {path},{path}], c={path}, d=.5)")[1] == {"b": [1, path, path], "c": path, "d": 0.5}


@pytest.mark.parametrize("value", [*PATHS, *NO_PATHS, "a.b", ["a/b", "c d", ["/e", 1]], -0.5, 1e-300, None, True])
def test_what_is_spelled_is_read(value: object) -> None:
    assert parse_spec("x", spell_spec("a", {"b": value, "c": [value]})) == ("a", {"b": value, "c": [value]})


@pytest.mark.parametrize("number", ["1.5", "-.5", "1e-3", "1.", "1_000.0"])
def test_numbers_are_no_paths(number: str) -> None:
    assert parse_spec("x", f"a(b={number})")[1] == {"b": float(number)}


def test_true_and_false_may_be_written_as_in_yaml() -> None:
    assert parse_spec("x", "a(b=true, c=false, d='true', e=True)")[1] == {"b": True, "c": False, "d": "true", "e": True}


def test_quoted_texts_are_left_alone() -> None:
    assert parse_spec("x", """a(b="c=/d/e, f", g='[h/i]')""")[1] == {"b": "c=/d/e, f", "g": "[h/i]"}


@pytest.mark.parametrize("given", ["/a/b", "a/b=3", "c=1/2", "c=a/b+d", "c=a/b(d)", "c='x'a/b", "c=a/b'x'", "c=0.5m"])
def test_other_shapes_are_refused(given: str) -> None:
    with pytest.raises(InvalidValueError, match="paths, other texts in quotes"):
        parse_spec("x", f"a({given})")
