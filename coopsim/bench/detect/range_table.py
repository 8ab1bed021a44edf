"""Average precision by range and class: a line for each kind of object, a column for each band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tabulate import tabulate

from coopsim.bench.detect.protocols import CoopsimProtocol
from coopsim.errors import InvalidValueError

KINDS = ("", " people", " riders")
"""Kinds of objects with bands, by the ends of their metrics' names."""

_THRESHOLDS = {"": (0.3, 0.5, 0.7), " people": (0.3, 0.5), " riders": (0.3, 0.5)}
_CLASSES = tuple(kind for kind in CoopsimProtocol.kinds if kind not in (*KINDS, " vulnerable"))
_TITLES = {"": "vehicles"}


def require_ranges(protocol: str) -> None:
    """Raise `InvalidValueError` for a protocol without bands."""
    if protocol != "coopsim":
        raise InvalidValueError(f"--by-range needs the protocol coopsim, whose metrics have bands, got {protocol!r}")


def range_table(row: Mapping[str, Any]) -> str:
    """Format one row of the protocol coopsim as a Markdown table, with numbers of objects in brackets.

    A cell has average precision in BEV at IoU 0.3, 0.5 and 0.7, of people, riders and single classes 0.3 and 0.5.
    Kinds, classes and bands without an object are left out.
    """
    counts: Mapping[str, int] = row["objects_of"]
    bands = [f" {near_m:g}-{far_m:g}m" for near_m, far_m in CoopsimProtocol.bands_m]
    bands = [band for band in bands if any(counts.get(f"{kind}{band}") for kind in KINDS)]
    lines = []
    for kind in (*KINDS, *_CLASSES):
        if counts.get(kind):
            cells = [_cell(row, kind, part) if kind in KINDS else "" for part in bands]
            lines.append([_TITLES.get(kind, kind.strip()), *cells, _cell(row, kind, "")])
    header = ["AP (BEV) at IoU", *(band.strip() for band in bands), "all"]
    of = f"{row['policy']}, {row['environment']}, {row['frames']} frames"
    return f"{of}\n\n{tabulate(lines, headers=header, tablefmt='github', disable_numparse=True)}"


def _cell(row: Mapping[str, Any], kind: str, part: str) -> str:
    count = row["objects_of"].get(f"{kind}{part}", 0)
    if not count:
        return "-"
    found = (row[f"APBEV@{least:g}{kind}{part}"] for least in _THRESHOLDS.get(kind, (0.3, 0.5)))
    return f"{' / '.join(f'{value:.2f}'.lstrip('0') for value in found)} ({count})"
