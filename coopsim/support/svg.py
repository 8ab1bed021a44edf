"""Charts as SVG, drawn by matplotlib, which is loaded when the first is drawn."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def to_svg(draw: Callable[[Figure], object], width_in: float, height_in: float) -> str:
    """Return as SVG what a function draws on a matplotlib figure of a size in inches.

    Text stays text, and the same drawing gives the same bytes.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    text = io.StringIO()
    # No date and no random ids: the same numbers give the same file.
    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return text.getvalue()


def line_style(number: int) -> tuple[str, str]:
    """Return matplotlib's style and colour of line `number`; the first 30 lines all look different."""
    return ("-", "--", ":")[number // 10 % 3], f"C{number % 10}"
