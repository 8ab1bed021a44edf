"""Beam tables from files, for custom sensors."""

from __future__ import annotations

import csv
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from coopsim.config.yaml_file import read_yaml
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.support.checks import require_between, require_number

ELEVATION, AZIMUTH = "elevation_deg", "azimuth_deg"
SUFFIXES = (".csv", ".yaml", ".yml")

_CHECKS: dict[str, Callable[..., None]] = {
    ELEVATION: partial(require_number, "a number in (-90, 90)", lambda degrees: abs(degrees) < 90),
    AZIMUTH: partial(require_between, -180, 180),
}


def find_pattern(name: str) -> BeamPattern:
    """Return a beam table by its name in `PATTERNS` or, if it ends in .csv, .yaml or .yml, by its path.

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
        InvalidValueError: names the file, the line if known, and what is wrong.
    """
    path = Path(path)
    table = _from_csv(path) if path.suffix.lower() == ".csv" else _from_yaml(path)
    elevation, azimuth = table[ELEVATION], table.get(AZIMUTH)
    if not elevation:
        raise InvalidValueError(f"{path}: a beam table must have at least one beam, got none")
    if azimuth is not None and len(azimuth) != len(elevation):
        raise InvalidValueError(f"{path}: {len(elevation)} {ELEVATION} need as many {AZIMUTH}, got {len(azimuth)}")
    return BeamPattern(path.stem, np.radians(elevation), None if azimuth is None else np.radians(azimuth))


def _from_csv(path: Path) -> dict[str, list[float]]:
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidValueError(f"cannot read the beam table {path}: {error}") from error
    reader = csv.reader(text.splitlines())
    header = [cell.strip() for cell in next(reader, [])]
    if header not in ([ELEVATION], [ELEVATION, AZIMUTH], [AZIMUTH, ELEVATION]):
        raise InvalidValueError(
            f"{path}:1: a beam table has the columns {ELEVATION} and, if any, {AZIMUTH}, got {header}"
        )
    table: dict[str, list[float]] = {key: [] for key in header}
    for row in reader:
        at = f"{path}:{reader.line_num}"
        if row and len(row) != len(header):
            raise InvalidValueError(f"{at}: a beam has {len(header)} values, got {len(row)}")
        for key, cell in zip(header, row, strict=False):
            table[key].append(_degrees(at, key, cell.strip()))
    return table


def _degrees(at: str, key: str, cell: str) -> float:
    try:
        value = float(cell)
        _CHECKS[key](**{key: value})
    except InvalidValueError as error:
        raise InvalidValueError(f"{at}: {error}") from error
    except ValueError:
        raise InvalidValueError(f"{at}: {key} must be a number, got {cell!r}") from None
    return value


def _from_yaml(path: Path) -> dict[str, list[float]]:
    fields = read_yaml(path, InvalidValueError).fields([ELEVATION], [AZIMUTH])
    return {key: [float(item.checked(_CHECKS[key])) for item in entry.entries()] for key, entry in fields.items()}
