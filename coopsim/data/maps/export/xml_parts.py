"""XML elements and the text of a file."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element as Element

from coopsim.geometry.se3 import Floats

_DECIMALS = 9


def text_of(value: object) -> str:
    """Return the text of an attribute's value: `true`, `7`, `12.5`, `-1.25e-07`."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(round(float(value), _DECIMALS) + 0.0)  # numpy's numbers as Python's, and no -0.0
    return str(value)


def put(parent: Element, tag: str, attributes: Mapping[str, object] | None = None, **more: object) -> Element:
    """Add an element; attributes that are None are left out."""
    given = {**(attributes or {}), **more}
    texts = {name: text_of(value) for name, value in given.items() if value is not None}
    return ElementTree.SubElement(parent, tag, texts)


def shape_text(line: Floats) -> str:
    """Return places (K, 2) m as SUMO writes them, to the millimetre: `1.0,2.5 3.0,2.5`."""
    return " ".join(f"{x + 0.0},{y + 0.0}" for x, y in line.round(3).tolist())


def document(root: Element) -> str:
    """Return the text of a file."""
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'
