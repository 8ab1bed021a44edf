"""`coopsim log`: what is in a log of traffic."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.cli.arguments import Command


def _add_log(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("log", type=Path, metavar="FILE", help="a log of traffic, or a folder of recordings")
    add("--part", metavar="NAME", help="case of INTERACTION, or sequence of a folder (default: the first)")
    add("--out", type=Path, metavar="FILE.csv", help="write it as a plain table, .csv or .parquet")


def _run_log(options: argparse.Namespace) -> int:
    from coopsim.data.logs.reading import read_log
    from coopsim.data.logs.summary import describe_log, write_table

    log = read_log(options.log, options.part)
    for line in describe_log(log):
        print(line)
    if options.out is not None:
        print(f"written: {write_table(options.out, log)}")
    return 0


LOG = Command(
    "read a log of real or simulated traffic: say who is in it, what was filled and left out; write it as a table",
    _add_log,
    _run_log,
    ("coopsim log cologne8.fcd.xml.gz", "coopsim log 07_tracks.csv --out street.csv"),
)
