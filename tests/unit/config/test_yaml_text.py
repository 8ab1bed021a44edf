"""Plain data written as YAML reads back to the same values, and is laid out for people."""

import math
from typing import Any

import yaml
from hypothesis import given
from hypothesis import strategies as st

from coopsim.config.yaml_file import yaml_text

TEXTS = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"]), max_size=8)
SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXTS
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4))


@given(st.dictionaries(TEXTS, VALUES, max_size=5))
def test_every_value_reads_back_to_the_same(content: dict[str, Any]) -> None:
    assert repr(yaml.safe_load(yaml_text(content))) == repr(content) or not content


def test_words_that_yaml_reads_otherwise_are_quoted() -> None:
    content = {"no": ["on", "1", "1e3", "~", "0x10", "a: b", "a#b", "", "2020-01-01", "plain", "a>b.0"]}
    assert yaml.safe_load(yaml_text(content)) == content


def test_numbers_without_a_point_keep_being_numbers() -> None:
    content = {"x": [1e-05, -2e16, 1.5e-7, math.inf, -0.0, 3, True]}
    assert repr(yaml.safe_load(yaml_text(content))) == repr(content)


def test_items_of_lists_have_a_line_each() -> None:
    content = {"place": {"nodes": {"a": [0, -2.5]}, "roads": [{"from": "a", "via": [[1, 2]]}], "speeds": [1, 2]}}
    assert yaml_text(content) == (
        "place:\n  nodes:\n    a: [0, -2.5]\n  roads:\n    - {from: a, via: [[1, 2]]}\n  speeds: [1, 2]\n"
    )
