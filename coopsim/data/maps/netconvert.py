"""Run SUMO's netconvert, a program of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from coopsim.errors import MissingDependencyError

LONGEST_S = 300.0
MOST_LETTERS = 200
"""Of what netconvert says, in a message."""

_INSTALL = "pip install 'coopsim[sumo]', or on Debian: apt-get install sumo"


def is_there() -> bool:
    """Return whether netconvert is installed."""
    return _home() is not None


def run_netconvert(options: Mapping[str, str], needed: str) -> tuple[int, list[str]]:
    """Run netconvert with options by name, and return its exit status and the lines that it said.

    Raises:
        MissingDependencyError: netconvert is not installed; begins with `needed`.
        OSError: it cannot run; names the program.
        subprocess.TimeoutExpired: it took more than 300 s.
    """
    home = _home()
    if home is None:
        raise MissingDependencyError(f"{needed}: {_INSTALL}")
    program, environment = home
    command = [str(program), *(word for name, value in options.items() for word in (f"--{name}", value))]
    done = subprocess.run(command, env=environment, capture_output=True, timeout=LONGEST_S, check=False)
    return done.returncode, done.stderr.decode(errors="replace").splitlines()


def _home() -> tuple[Path, dict[str, str]] | None:
    """Return netconvert and the environment that it needs: of the package `eclipse-sumo`, else on the path; or None."""
    package = find_spec("sumo")
    folder = Path(next(iter(package.submodule_search_locations or ()), "")) if package is not None else Path()
    program = folder / "bin" / "netconvert"
    if package is not None and program.is_file():
        return program, {**os.environ, "SUMO_HOME": str(folder)}
    found = shutil.which("netconvert")
    return None if found is None else (Path(found), dict(os.environ))
