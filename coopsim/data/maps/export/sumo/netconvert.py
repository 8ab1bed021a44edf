"""Run SUMO's netconvert: a network from plain XML."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from coopsim.errors import ExportError, MissingDependencyError

_INSTALL = "pip install 'coopsim[sumo]', or on Debian: apt-get install sumo"
_LONGEST_S, _MOST_LETTERS = 300.0, 200
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
    program = _find()
    with TemporaryDirectory() as folder:
        paths = {name: Path(folder, f"{name}.xml") for name in files}
        for name, path in paths.items():
            path.write_text(files[name], encoding="utf-8")
        made = Path(folder, "made.net.xml")
        options = {**_OPTIONS, "lefthand": str(left_hand).lower(), **paths, "output-file": made}
        command = [program, *(word for name, value in options.items() for word in (f"--{name}", str(value)))]
        environment = {**os.environ, "SUMO_HOME": str(Path(program).parent.parent)}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=_LONGEST_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f"cannot run {program}: {error}") from error
        if done.returncode != 0 or not made.is_file():
            said = [line for line in done.stderr.decode(errors="replace").splitlines() if line.startswith("Error")]
            raise ExportError(f"netconvert made no network: {' '.join(said)[:_MOST_LETTERS]}")
        # The comment has the day and the paths of this machine.
        return re.sub(r"<!--.*?-->\s*", "", made.read_text(encoding="utf-8"), flags=re.DOTALL)


def _find() -> str:
    """Return the program: of the package `eclipse-sumo`, else on the path."""
    package = find_spec("sumo")
    for folder in (package.submodule_search_locations or ()) if package is not None else ():
        if (program := Path(folder, "bin", "netconvert")).is_file():
            return str(program)
    found = shutil.which("netconvert")
    if found is None:
        raise MissingDependencyError(f"a network of SUMO is made by netconvert: {_INSTALL}")
    return found
