"""Reads a page as a browser would, and names that must not become markup."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from typing import Any

HOSTILE = [
    "</script><script>alert(1)</script>",
    "<!--<script>",
    "\"' onmouseover='alert(1)",
    "a & b &lt; c",
    "$title ${data} $$",
]


class Page(HTMLParser):
    """What a browser would see: elements with attributes, and the text of each."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.open: list[list[str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        text: list[str] = []
        self.elements.append((tag, dict(attrs), text))
        if tag not in {"meta", "img", "input"}:  # these have no end
            self.open.append(text)

    def handle_endtag(self, tag: str) -> None:
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open:
            self.open[-1].append(data)

    def texts(self, tag: str, css: str | None = None) -> list[str]:
        return ["".join(text) for name, attrs, text in self.elements if name == tag and attrs.get("class") == css]

    @property
    def data(self) -> Any:
        (text,) = [text for _, attrs, text in self.elements if attrs.get("type") == "application/json"]
        return json.loads("".join(text))
