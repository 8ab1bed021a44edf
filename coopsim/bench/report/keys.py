"""The legend of the views from above in pages: marks by class of the style sheet, and what they mean."""

from __future__ import annotations

from collections.abc import Iterable

from coopsim.viz import palette

_WORDS = {
    "truth": "object that is there",
    "ego": "the agent that the picture is about",
    "agent": "other agent",
    "track": "its track of an object",
    "false": "false track: nothing is there",
    "news": "a message has just told of it",
    "hidden": "what the car must not touch, without a track of it",
    "known": "the same, with a track of it",
    "told": "message that arrives",
    "claimed": "claimed by the liar",
    "denied": "there, and left out or moved by the liar",
    "stated": "the liar, with a line to where its message says it is",
}

_COLORS = {
    "truth": palette.TRUTH,
    "ego": palette.AGENT,
    "agent": palette.CONNECTED,
    "track": palette.TRACK,
    "news": palette.CONNECTED,
    "hidden": palette.TRUTH,  # of its ring, which is white in the views: they are dark, and the page may be light
    "known": palette.TRACK,
    "told": palette.CONNECTED,
}
"""Colours of marks, as in the views."""

SCENE = ("truth", "ego", "agent", "track", "false", "news")
"""Marks of every view."""

FALSE_NOTE = """Detectors report objects where nothing is, and trackers follow some of them: such false tracks are part
of what is measured, and pictures draw them thin, grey and crossed out."""


def keys_html(names: Iterable[str]) -> str:
    """Return the legend with marks of these names."""
    keys = "".join(f'<span class="key"><i class="{name}"{_style(name)}></i>{_WORDS[name]}</span>' for name in names)
    return f'<div class="keys">{keys}</div>'


def _style(name: str) -> str:
    color = _COLORS.get(name)
    filled = f";background:rgb{color}" * (name == "ego")
    return "" if color is None else f' style="border-color:rgb{color}{filled}"'
