"""Self-contained HTML pages."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from importlib import resources
from string import Template


def fill_page(
    content: str,
    *,
    title: str,
    summary: str,
    style: tuple[str, ...],
    script: tuple[str, ...],
    data: object,
    **parts: str,
) -> str:
    """Fill the template of a page that opens without a network (`template/page.html`).

    `content`, `style` and `script` are files in `template/`; `title` and `summary` are plain text; `data` goes to the
    scripts as JSON; `parts` are HTML for the placeholders in `content`.
    """
    # "<" could end the script element ("</script>") or keep it from ending ("<!--<script>"), in any string.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return Template(template("page.html")).substitute(
        title=html.escape(title),
        summary=html.escape(summary),
        main=Template(template(content)).substitute(parts),
        style="\n".join(map(template, style)),
        script="\n".join(map(template, script)),
        data=text,
    )


def definitions(texts: Mapping[str, str]) -> str:
    """Format names with their meanings or values as an HTML list."""
    items = (f"<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>" for name, text in texts.items())
    return f"<dl>{''.join(items)}</dl>"


def template(name: str) -> str:
    """Read a file in `template/`."""
    return (resources.files("coopsim.bench.report") / "template" / name).read_text(encoding="utf-8")
