"""Kernels that are kept compiled: never those of other sources, and where nobody else can plant any."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.support import kernels

ROOT = Path(coopsim.__file__).parents[1]

KERNEL = (
    "from coopsim.support.kernels import njit\n{imports}\n\n@njit(cache=True)\ndef {name}(x):\n    return {value}\n"
)
SHOW = "from coopsim.caller import outer; print(outer(1.0))"


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """Make a small package of our name: a kernel that calls one of another file, which takes a constant of a third."""
    package = tmp_path / "house" / "coopsim"
    (package / "support").mkdir(parents=True)
    for name in ("__init__.py", "support/__init__.py"):
        (package / name).touch()
    shutil.copy(kernels.__file__, package / "support")
    (package / "numbers.py").write_text("FACTOR = 2.0\n")
    imports = "from coopsim import numbers"
    (package / "called.py").write_text(KERNEL.format(imports=imports, name="inner", value="numbers.FACTOR * x"))
    imports = "from coopsim.called import (\n    inner,\n)"
    (package / "caller.py").write_text(KERNEL.format(imports=imports, name="outer", value="inner(x) + 1.0"))
    return package


def run(house: Path, code: str = SHOW, *, prefix: tuple[str, ...] = (), **env: str) -> str:
    command = [*prefix, sys.executable, "-c", code]
    usual = {"PATH": os.environ["PATH"], "HOME": str(house.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=house.parent, env=usual | env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def versions(house: Path, module: str) -> list[Path]:
    return list((house / "__pycache__").glob(f"{module}-*"))


def test_a_kernel_is_compiled_anew_when_what_it_is_made_of_changes(house: Path) -> None:
    # The kernel's own file stays as it is; numba alone goes on with the old numbers.
    assert run(house) == "3.0\n"
    first = {path: path.stat().st_mtime_ns for path in house.rglob("*.nb?")}
    assert len(first) == 4, "an index and a kernel of each module"
    (house / "numbers.py").write_text("FACTOR = 5.0\n")
    assert run(house) == "6.0\n"
    (house / "numbers.py").write_text("FACTOR = 2.0\n")
    assert run(house) == "3.0\n"
    assert {path: path.stat().st_mtime_ns for path in first} == first, "the first version is used again"
    assert len(versions(house, "caller")) == len(versions(house, "called")) == 2


def test_a_module_that_is_executed_anew_has_another_digest(house: Path) -> None:
    code = (
        "import importlib, pathlib; from coopsim import called, caller, numbers; print(called.inner(1.0));"
        "pathlib.Path(called.__file__).write_text(pathlib.Path(called.__file__).read_text().replace('* x', '* x * x'));"
        "importlib.reload(called); print(called.inner(3.0))"
    )
    assert run(house, code) == "2.0\n18.0\n"
    assert len(versions(house, "called")) == 2


def test_old_versions_are_removed_but_for_the_last_few(house: Path) -> None:
    for age in range(9):
        old = house / "__pycache__" / f"caller-{age}"
        old.mkdir(parents=True)
        os.utime(old, (age, age))
    for name in ("caller-recent", "called-old"):
        (house / "__pycache__" / name).mkdir()
    run(house)
    left = {path.name for path in versions(house, "caller")}
    assert {"caller-recent", "caller-8", "caller-7"} < left and len(left) == 4
    assert len(versions(house, "called")) == 2, "another module's are left alone"


def test_the_folder_that_the_user_names_is_used(house: Path, tmp_path: Path) -> None:
    chosen = tmp_path / "chosen"
    assert run(house, NUMBA_CACHE_DIR=str(chosen)) == "3.0\n"
    assert len(list(chosen.rglob("*.nbi"))) == 2 and not versions(house, "caller")


def as_nobody() -> tuple[str, ...]:
    """Return the words that run a command without root's right to write anywhere."""
    if not hasattr(os, "getuid"):
        pytest.skip("needs users as POSIX has them")
    if os.getuid():
        return ()
    if shutil.which("setpriv") is None:
        pytest.skip("root writes everywhere, and setpriv is not here")
    given = (
        "--inh-caps=-all,+dac_read_search",
        "--ambient-caps=+dac_read_search",
        "--bounding-set=-all,+dac_read_search",
    )
    return ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", *given)


@pytest.fixture
def nowhere(house: Path, tmp_path: Path) -> dict[str, Any]:
    """Make the package and the home unwritable; return settings of a process that may write temporary files alone."""
    prefix = as_nobody()
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    temporary.chmod(0o1777)
    for folder in [house, *(path for path in house.rglob("*") if path.is_dir())]:
        folder.chmod(0o555)
    return {"prefix": prefix, "HOME": "/nonexistent", "TMPDIR": str(temporary)}


def test_kernels_are_kept_among_temporary_files_where_nothing_else_can_be_written(
    house: Path, nowhere: dict[str, Any]
) -> None:
    said = run(house, **nowhere)
    assert said.startswith("3.0\n") and said.count("NUMBA_CACHE_DIR") == said.count("Warning") == 1
    (own,) = Path(nowhere["TMPDIR"]).glob("coopsim-kernels-*")
    indexes = list(own.rglob("*.nbi"))
    assert own.stat().st_mode & 0o777 == 0o700 and len(indexes) == 2
    # Others may have planted files there, and reading one would run its code.
    own.chmod(0o777)
    for index in indexes:
        index.write_bytes(b"planted")
    said = run(house, **nowhere)
    assert said.startswith("3.0\n") and f"{own}-" not in said and f"kept in {own};" not in said
    assert {index.read_bytes() for index in indexes} == {b"planted"}
    assert list(Path(nowhere["TMPDIR"]).glob("coopsim-kernels-*")) == [own], "and it is removed"


def test_where_no_folder_can_be_had_nothing_is_kept(house: Path, nowhere: dict[str, Any]) -> None:
    code = f"import tempfile; tempfile.tempdir = '/proc/none'; {SHOW}"
    said = run(house, code, **nowhere)
    assert said.startswith("3.0\n") and "kept nowhere" in said


def test_all_kernels_of_ours_are_kept_so() -> None:
    files = [path for room in ("coopsim", "envs", "agents") for path in (ROOT / room).rglob("*.py")]
    direct = re.compile(r"^\s*(from|import) numba\b", re.MULTILINE)
    found = [path.name for path in files if direct.search(path.read_text())]
    assert len(files) > 400 and set(found) == {"kernels.py"}
