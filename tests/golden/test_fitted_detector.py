"""The numbers of the fitted detector come out of the script that fits them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from coopsim.detection.presets import FITTED

SCRIPT = Path(__file__).parents[2] / "scripts" / "fit_detector.py"


@pytest.mark.long
def test_the_script_gives_the_file_that_ships(v2v4real: Path, tmp_path: Path) -> None:
    written = tmp_path / "fitted.yaml"
    data, path = v2v4real.parents[1], os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, str(SCRIPT), str(data), "--out", str(written)]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": path})
    assert written.read_bytes() == (FITTED / "pointpillars_v2v4real.yaml").read_bytes()
