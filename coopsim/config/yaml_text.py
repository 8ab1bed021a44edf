"""Plain data as compact YAML that reads back to the same values: a line for every item of a list."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.>+-]*")
_RESOLVER = yaml.resolver.Resolver()


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return a document. Mappings are blocks, lists of lists or mappings have a line for each item, others one line.

    Args:
        content: mappings, lists, texts, numbers, flags and None; numbers read back to the same bits.
    """
    return "\n".join(_block(content, "")) + "\n"


def _block(value: Any, indent: str) -> Iterator[str]:
    """Yield the lines of a mapping or list."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if _is_block(item):
                yield f"{indent}{_scalar(str(key))}:"
                yield from _block(item, indent + "  ")
            else:
                yield f"{indent}{_scalar(str(key))}: {_flow(item)}"
    else:
        yield from (f"{indent}- {_flow(item)}" for item in value)


def _is_block(value: Any) -> bool:
    if isinstance(value, Mapping):
        return bool(value)
    return isinstance(value, (list, tuple)) and any(isinstance(item, (list, tuple, Mapping)) for item in value)


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_scalar(str(key))}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, float):
        return _float(float(value))
    if isinstance(value, str):
        return value if _is_plain(value) else json.dumps(value, ensure_ascii=False)
    return str(value)


def _float(value: float) -> str:
    """Return the shortest text of a number that reads back to it; YAML asks for a point before an exponent."""
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _is_plain(text: str) -> bool:
    """Return whether a text needs no quotes: it is a word, and none of YAML's own, as "no"."""
    resolved = _RESOLVER.resolve(yaml.ScalarNode, text, (True, False))
    return _PLAIN.fullmatch(text) is not None and resolved == "tag:yaml.org,2002:str"
