"""Beam tables from files, for sensors of one's own."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.mappings import UNREADABLE
from coopsim.sensors.patterns import PATTERNS, BeamPattern

COLUMNS = ("elevation_deg", "azimuth_deg")
SUFFIXES = (".csv", ".yaml", ".yml")


def find_pattern(name: str) -> BeamPattern:
    """A beam table by its name in `PATTERNS` or, if it ends in .csv, .yaml or .yml, by its path.

    Raises:
        UnknownNameError: no such name.
        InvalidValueError: no such file, or no beam table in it.
    """
    if isinstance(name, str) and name.lower().endswith(SUFFIXES):
        return load_pattern(name)
    return PATTERNS.get(name)


def load_pattern(path: str | Path) -> BeamPattern:
    """Read a beam table.

    CSV: a header `elevation_deg` or `elevation_deg,azimuth_deg`, then a line for each beam. YAML: a mapping with the
    same keys, each a list with an entry for each beam. Elevation is positive upwards, azimuth to the left, as in
    `BeamPattern`.

    Raises:
        InvalidValueError: names the file and what is wrong.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidValueError(f"cannot read the beam table {path}: {error}") from error
    table = _from_csv(path, text) if path.suffix.lower() == ".csv" else _from_yaml(path, text)
    if COLUMNS[0] not in table or set(table) - set(COLUMNS):
        raise InvalidValueError(f"{path}: a beam table has elevation_deg and may have azimuth_deg, got {sorted(table)}")
    try:
        radians = {key: np.radians(np.asarray(values, dtype=np.float64)) for key, values in table.items()}
        return BeamPattern(path.stem, radians[COLUMNS[0]], radians.get(COLUMNS[1]))
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{path}: {error}") from error


def _from_csv(path: Path, text: str) -> dict[str, list[float]]:
    header, *lines = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if row] or [[]]
    table: dict[str, list[float]] = {key: [] for key in header}
    for number, row in enumerate(lines, start=1):
        if len(row) != len(header):
            raise InvalidValueError(f"{path}: beam {number} has {len(row)} values for {len(header)} columns")
        for key, cell in zip(header, row, strict=True):
            try:
                table[key].append(float(cell))
            except ValueError:
                raise InvalidValueError(f"{path}: {key} of beam {number} must be a number, got {cell!r}") from None
    return table


def _from_yaml(path: Path, text: str) -> dict[str, Any]:
    import yaml

    try:
        table = yaml.safe_load(text)
    except UNREADABLE as error:
        raise InvalidValueError(f"{path} is no YAML: {error}") from error
    if not isinstance(table, dict):
        raise InvalidValueError(f"{path}: a beam table is a mapping with elevation_deg, got {type(table).__name__}")
    return {str(key): values for key, values in table.items()}
