"""Pages that open without a network: what all have in common."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from importlib import resources
from string import Template


def fill(
    content: str,
    *,
    title: str,
    summary: str,
    style: tuple[str, ...],
    script: tuple[str, ...],
    data: object,
    **parts: str,
) -> str:
    """A page: the frame that all share (`template/page.html`) around one content.

    Args:
        content: file in `template/` of what stands between head and scripts.
        title: plain text.
        summary: plain text, under the title.
        style: files in `template/`, in order.
        script: files in `template/`, in order.
        data: for the scripts.
        parts: HTML by the names that the content has for it.
    """
    # "<" could end the script element ("</script>") or keep it from ending ("<!--<script>"), whatever string it
    # stands in.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return Template(_read("page.html")).substitute(
        title=html.escape(title),
        summary=html.escape(summary),
        main=Template(_read(content)).substitute(parts),
        style="\n".join(map(_read, style)),
        script="\n".join(map(_read, script)),
        data=text,
    )


def definitions(texts: Mapping[str, str]) -> str:
    """Names and what they mean or are, as a list."""
    items = (f"<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>" for name, text in texts.items())
    return f"<dl>{''.join(items)}</dl>"


def _read(name: str) -> str:
    return (resources.files("coopsim.bench.report") / "template" / name).read_text(encoding="utf-8")
