"""Plots as SVG files: text stays text, and the same results give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def to_svg(draw: Callable[[Figure], object], width_in: float, height_in: float) -> str:
    """What a function draws on a figure of that size (inches)."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    text = io.StringIO()
    # No date and no random ids: the same results give the same file.
    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return text.getvalue()


def line_look(number: int) -> tuple[str, str]:
    """Style and colour by which a line is told from the others, whatever their number up to 30."""
    return ("-", "--", ":")[number // 10 % 3], f"C{number % 10}"
