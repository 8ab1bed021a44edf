"""The files of a benchmark that papers need: tables, a figure, and the protocol."""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.bench.paper.interval_rows import to_csv
from coopsim.bench.paper.latex_tables import latex_tables
from coopsim.bench.paper.protocol_text import protocol_text
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.paper.trade_off_plot import trade_off
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import UnknownNameError
from coopsim.metrics.built_in import BYTES
from coopsim.metrics.metric import PRIMARY_METRIC

METRICS = (PRIMARY_METRIC, "AMOTA", "AMOTP", "HOTA", "IDS")
"""The metrics of the tables; the first one is that of the figure and of the tables by axis."""


def paper_files(table: ResultTable, provenance: Provenance, metrics: Sequence[str] = ()) -> dict[str, str]:
    """Return the contents of files by name; results of unfinished grids have them, too.

    These are `protocol.txt`, `intervals.csv`, `tables/*.tex`, and `plots/METRIC_over_bytes.svg` where bytes were
    counted. Without any value there is the protocol alone.

    Args:
        table: the results.
        provenance: of their grid.
        metrics: names; default: those of `METRICS` that the results have, or else all that reports show.

    Raises:
        UnknownNameError: the results have no such metric.
    """
    for name in metrics:
        if name not in table.metrics or name == BYTES:
            raise UnknownNameError("metric", name, table.shown)
    chosen = tuple(metrics) or tuple(name for name in METRICS if name in table.metrics) or table.shown
    files = {"protocol.txt": protocol_text(table, provenance, chosen)}
    if not chosen:
        return files
    files["intervals.csv"] = to_csv(table, chosen)
    files |= {f"tables/{name}": text for name, text in latex_tables(table, chosen).items()}
    if BYTES in table.metrics:
        files[f"plots/{chosen[0]}_over_bytes.svg"] = trade_off(table, chosen[0], provenance.sends)
    return files
