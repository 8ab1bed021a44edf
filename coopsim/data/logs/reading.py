"""Read a log of any format: the name and the beginning of a file tell which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from coopsim.data.logs import other_tables
from coopsim.data.logs.filling import Columns, make_log
from coopsim.data.logs.floating_cars import PARQUET, floating_columns, floating_table_columns
from coopsim.data.logs.level_x import is_level_x, level_x_columns
from coopsim.data.logs.plain_table import NEEDED, plain_columns
from coopsim.data.logs.recorded import recorded_columns
from coopsim.data.logs.scenario_net import scenario_columns
from coopsim.data.logs.tables import Table
from coopsim.data.logs.text_labels import is_text_folder, text_columns
from coopsim.data.logs.track_log import TrackLog
from coopsim.errors import LogFileError

TABLES: dict[str, tuple[tuple[str, ...], Callable[[Table], Columns]]] = {
    "table": (NEEDED, plain_columns),
    "interaction": (other_tables.INTERACTION, other_tables.interaction_columns),
    "argoverse2": (other_tables.ARGOVERSE, other_tables.argoverse_columns),
    "sumo": (PARQUET, floating_table_columns),
}
"""Formats of single tables: columns that tell one, and its reader."""

ENDS = (".csv", ".csv.gz", ".parquet", ".fcd.xml", ".fcd.xml.gz", ".pkl")

_ACCEPTED = (
    "accepted: tables (.csv, .csv.gz, .parquet) with the columns time_s, id, x_m, y_m, or of INTERACTION or "
    "Argoverse 2; NN_tracks.csv of levelX; floating car data of SUMO (.fcd.xml, .gz, .parquet); pickles of "
    "ScenarioNet (.pkl); folders of recordings (nuScenes, KITTI, V2V4Real, OPV2V, V2X-Seq)"
)


def read_log(path: str | Path, part: str | None = None) -> TrackLog:
    """Read a log.

    Args:
        path: a file, or a folder of recordings.
        part: case of a table of INTERACTION, or sequence of a folder; None: the first.

    Raises:
        LogFileError: the file is missing, broken or of another format; names the row and its id.
        RecordingError: a folder has no known format, or a file in it is missing or broken.
    """
    file = Path(path)
    if file.is_dir() and is_text_folder(file):
        name, columns = text_columns(file, part)
        return make_log(str(file), f"labels in text, sequence {name}", columns)
    if file.is_dir():
        name, columns = recorded_columns(file, part)
        return make_log(str(file), f"recordings, sequence {name}", columns)
    if not file.is_file():
        raise LogFileError(f"no file {file}")
    if is_level_x(file):
        return make_log(str(file), "levelx", level_x_columns(file))
    if file.suffix == ".pkl":
        return make_log(str(file), "scenarionet", scenario_columns(file))
    if file.name.endswith((".fcd.xml", ".fcd.xml.gz")):
        return make_log(str(file), "sumo", floating_columns(file))
    if not file.name.endswith(ENDS):
        raise LogFileError(f"{file} is no log by its name; {_ACCEPTED}")
    table = Table(file)
    for name, (needed, reader) in TABLES.items():
        if set(needed) <= set(table.names):
            return make_log(str(file), name, _read(reader, table, part))
    there = ", ".join(table.names[:20])
    raise LogFileError(f"{file} has the columns {there}, which are those of no format; {_ACCEPTED}")


def _read(reader: Callable[..., Columns], table: Table, part: str | None) -> Columns:
    if part is None or reader is not other_tables.interaction_columns:
        return reader(table)
    if not part.isdecimal():
        raise LogFileError(f"{table.path}: a case must be a number, got {part!r}")
    return reader(table, int(part))
