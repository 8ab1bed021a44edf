"""Checks of exported folders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from coopsim.data.export.export_card import CARD, DONE, check_card, read_card
from coopsim.data.export.export_format import ExportFormat, make_export_format
from coopsim.data.export.problem import Problem
from coopsim.errors import ExportError


def check_export(folder: str | Path, format: str | None = None) -> Iterator[Problem]:  # noqa: A002
    """Yield what is wrong in an exported folder; nothing if all is well.

    Args:
        folder: the export.
        format: as of `coopsim.data.export.export_run.export`; None: as the folder's `export.json` says. Where it is
            given, the folder need not be an export of coopsim: only the format is checked.

    Raises:
        ExportError: there is no such folder, or it does not say its format.
        CoopsimError: the format is not known.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ExportError(f"there is no folder {folder}")
    if format is None and not (folder / CARD).is_file():
        raise ExportError(f"{folder} has no {CARD}: `coopsim export` did not write it. Say of which format it is")
    card = None if format is not None else read_card(folder)
    writer = make_export_format(str(card["format"]) if card is not None else str(format))
    return _problems(folder, writer, card)


def _problems(folder: Path, writer: ExportFormat, card: Mapping[str, Any] | None) -> Iterator[Problem]:
    if card is not None:
        yield from check_card(folder)
    if card is None or card["state"] == DONE:  # of an interrupted export, more is missing than would be told
        yield from writer.check(folder)
