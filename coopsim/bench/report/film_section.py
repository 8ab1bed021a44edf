"""Sections of a report that play films: figures of two runs side by side, with what happens in them."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from coopsim.bench.report.keys import keys_html
from coopsim.bench.report.space_data import SpaceView, space_html

_PLAYER = (
    '<div class="player"><button>Play</button><input type="range" min="0" value="0" aria-label="frame" '
    'autocomplete="off"><output aria-live="off"></output></div>'
)


@dataclass(frozen=True, slots=True)
class Panel:
    """Run in a figure of two.

    Attributes:
        name: name of the run.
        about: description beside the name.
        moments: moments that a reader may go to, s, with what happens; None: none are offered.
    """

    name: str
    about: str
    moments: Sequence[tuple[float, str]] | None = None

    def html(self, side: int) -> str:
        """Return the panel as HTML."""
        name = html.escape(self.name)
        told = [text for _, text in self.moments or ()]
        alternative = html.escape(". ".join([f"{self.name}, from above", *filter(None, [self.about]), *told]))
        buttons = "".join(
            f'<button class="moment" data-s="{at_s:.3f}">{html.escape(text)}</button>'
            for at_s, text in self.moments or ()
        )
        moments = "" if self.moments is None else f'<div class="moments">{buttons}</div>'
        return (
            f'<div><p><b>{name}</b> <span class="dim">{html.escape(self.about)}</span></p>'
            f'<canvas data-side="{side}" role="img" aria-label="{alternative}"></canvas>{moments}</div>'
        )


@dataclass(frozen=True, slots=True)
class Figure:
    """Two runs side by side, their plain data for the page's script, and in three dimensions if they were filmed so."""

    caption: str
    panels: Sequence[Panel]
    data: dict[str, Any]
    space: SpaceView | None = None


@dataclass(frozen=True, slots=True)
class FilmSection:
    """A section: its title, a note (HTML), marks of the legend, and figures."""

    title: str
    note: str
    keys: Sequence[str]
    figures: Sequence[Figure]

    def html(self, first: int, *, lead: bool = False) -> str:
        """Return the section; `first` is the number of its first figure's data in the page.

        In the `lead` of a page the words stand below the figure, which plays in three dimensions, too, as far as it was
        filmed so.
        """
        if not self.figures:
            return ""
        figures = "".join(
            f'<figure class="clip" data-pair="{first + k}">'
            f"<figcaption>{html.escape(each.caption)}</figcaption>"
            f'<div class="pair">{"".join(panel.html(side) for side, panel in enumerate(each.panels))}</div>'
            f"{_PLAYER}{space_html(each.space if lead else None)}</figure>"
            for k, each in enumerate(self.figures)
        )
        note, keys = f'<p class="note">{self.note}</p>', keys_html(self.keys)
        parts = (figures, keys, note) if lead else (note, keys, figures)
        return f"<section><h2>{self.title}</h2>{''.join(parts)}</section>"


def space_of(sections: Iterable[FilmSection]) -> SpaceView | None:
    """Return the first figure's view in three dimensions; of the others' a page has no room, for some MB each."""
    return next((each.figures[0].space for each in sections if each.figures), None)


def split_lead(sections: Sequence[FilmSection]) -> tuple[str, str]:
    """Return the first figure of all as a section of its own, and the others, as HTML."""
    known = [each for each in sections if each.figures]
    if not known:
        return "", ""
    first = known[0]
    lead = replace(first, title="One pair of runs", figures=first.figures[:1]).html(0, lead=True)
    rest = [replace(first, figures=first.figures[1:]), *known[1:]]
    return f'<div id="lead">{lead}</div>\n', "".join(_numbered(rest, 1))


def _numbered(sections: Iterable[FilmSection], first: int) -> Iterator[str]:
    for each in sections:
        yield each.html(first)
        first += len(each.figures)
