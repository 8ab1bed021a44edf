"""Run SUMO's netconvert: a network from plain XML."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from coopsim.data.maps.netconvert import MOST_LETTERS, run_netconvert
from coopsim.errors import ExportError

_OPTIONS = {
    "no-turnarounds": "true",  # loops are connections
    "offset.disable-normalization": "true",  # the town's own coordinates
    "precision": "3",
    "walkingareas": "true",
    "xml-validation": "never",
}


def make_network(files: Mapping[str, str], *, left_hand: bool) -> str:
    """Return the text of a network made of plain XML, whose texts are given by netconvert's options.

    Raises:
        MissingDependencyError: netconvert is not installed.
        ExportError: netconvert makes no network of it.
    """
    with TemporaryDirectory() as folder:
        paths = {name: Path(folder, f"{name}.xml") for name in files}
        for name, path in paths.items():
            path.write_text(files[name], encoding="utf-8")
        made = Path(folder, "made.net.xml")
        given = {name: str(path) for name, path in paths.items()}
        options = {**_OPTIONS, "lefthand": str(left_hand).lower(), **given, "output-file": str(made)}
        try:
            status, lines = run_netconvert(options, "a network of SUMO is made by netconvert")
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f"cannot run netconvert: {error}") from error
        if status != 0 or not made.is_file():
            said = [line for line in lines if line.startswith("Error")]
            raise ExportError(f"netconvert made no network: {' '.join(said)[:MOST_LETTERS]}")
        # The comment has the day and the paths of this machine.
        return re.sub(r"<!--.*?-->\s*", "", made.read_text(encoding="utf-8"), flags=re.DOTALL)
