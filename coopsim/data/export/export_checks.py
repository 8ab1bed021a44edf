"""Checks of exported folders."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from coopsim.data.export.export_card import CARD, check_card, read_card
from coopsim.data.export.export_format import make_export_format
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
    writer = make_export_format(str(read_card(folder)["format"]) if format is None else format)
    return _problems(folder, writer.check(folder), with_card=format is None)


def _problems(folder: Path, of_format: Iterator[Problem], *, with_card: bool) -> Iterator[Problem]:
    if with_card:
        yield from check_card(folder)
    yield from of_format
