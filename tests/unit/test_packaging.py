"""What only shows once the package is installed elsewhere."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from import_graph import arrows, circles, file_graph, folder_graph, room_graph

import coopsim

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_is_listed() -> None:
    """A package missing from the list is silently missing from the wheel."""
    # rglob does not follow the links to envs/ and agents/ in every Python version: they are looked through themselves.
    homes = {"coopsim": ROOT / "coopsim", "coopsim.envs": ROOT / "envs", "coopsim.agents": ROOT / "agents"}
    found = {
        ".".join((package, *init.parent.relative_to(folder).parts))
        for package, folder in homes.items()
        for init in folder.rglob("__init__.py")
    }
    assert sorted(PYPROJECT["tool"]["setuptools"]["packages"]) == sorted(found)


def test_every_folder_of_the_library_is_a_package() -> None:
    folders = {path.parent for path in (ROOT / "coopsim").rglob("*.py")}
    assert all((folder / "__init__.py").is_file() for folder in folders)


def test_plugins_of_pytest_that_others_install_do_no_harm(tmp_path: Path) -> None:
    """As dash's, which open3d brings: its old-style hook is a warning, and warnings are errors here."""
    (tmp_path / "old_style.py").write_text("import pytest\n@pytest.mark.tryfirst\ndef pytest_addhooks(): pass\n")
    facts = tmp_path / "old_style-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: old-style\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[pytest11]\nold_style = old_style\n")
    command = [sys.executable, "-m", "pytest", "--markers", "-p", "no:cacheprovider"]
    told = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr


def test_every_data_file_is_listed() -> None:
    """What is missing from the list is silently missing from the wheel, too."""
    listed = PYPROJECT["tool"]["setuptools"]["package-data"]
    patterns = [f"{package.replace('.', '/')}/{each}" for package, named in listed.items() for each in named]
    files = (path for path in (ROOT / "coopsim").rglob("*") if path.is_file() and path.suffix != ".py")
    data = [path.relative_to(ROOT) for path in files if "__pycache__" not in path.parts]
    assert len(data) >= len(patterns)
    assert [path for path in data if not any(path.match(pattern) for pattern in patterns)] == []


def test_citation_names_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == coopsim.__version__
    assert citation["license"] == PYPROJECT["project"]["license"]


def test_a_commit_runs_what_lint_runs() -> None:
    """The configuration of pre-commit has no rules or versions of its own that could differ."""
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    assert [hook["entry"] for repo in config["repos"] for hook in repo["hooks"]] == ["make lint"]


def test_links_make_the_source_tree_look_installed() -> None:
    for name in ("envs", "agents"):
        link = ROOT / "coopsim" / name
        assert link.is_symlink() and link.readlink() == Path("..") / name


HEAVY = ("torch", "safetensors", "moderngl", "pyrender", "OpenGL", "asn1tools", "trimesh", "scipy.stats")
SIMULATOR = ("coopsim.envs", "coopsim.world", "coopsim.detection", "highway_env", "pettingzoo", "embreex")


LIGHT = (
    "coopsim",
    "coopsim.envs",
    "coopsim.cli",
    "coopsim.detection.network_detectors",
    "coopsim.comms.uplinks.share_features",
    "coopsim.bench.benchmark",
    "coopsim.bench.detect.detect",
    "coopsim.bench.report.publish",
    "coopsim.learn.recipe",
    "coopsim.learn.clips.simulated",
)
POLICIES = ("coopsim.agents", "coopsim.agents.learned_fusion", "coopsim.agents.early_fusion")


@pytest.mark.parametrize(
    ("modules", "refused"), [(LIGHT, HEAVY), (POLICIES, HEAVY + SIMULATOR)], ids=["light", "policies"]
)
def test_import_loads_nothing_heavy(modules: tuple[str, ...], refused: tuple[str, ...]) -> None:
    """Checked by refusing, so that it also holds where torch is not installed."""
    program = f"""
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if any(name == each or name.startswith(each + ".") for each in {refused!r}):
            raise AssertionError("import of " + name)
sys.meta_path.insert(0, Refuse())
import {", ".join(modules)}
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd="/", check=False)
    assert done.returncode == 0, done.stderr


def test_no_file_imports_itself_by_way_of_others() -> None:
    assert circles(file_graph()) == []


def test_no_room_imports_itself_by_way_of_others() -> None:
    files = file_graph()
    assert {", ".join(group): arrows(files, group) for group in circles(room_graph(files))} == {}


@pytest.mark.parametrize("package", ["coopsim.bench.detect", "coopsim.learn", "coopsim.nn"])
def test_no_folder_of_a_room_imports_itself_by_way_of_others(package: str) -> None:
    assert circles(folder_graph(package, loose_apart=True)) == []


def runtime_imports(tree: ast.AST) -> list[str]:
    """Names of imported modules, without those that only type checkers see."""
    names: list[str] = []
    stack = [tree]
    while stack:
        node = stack.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            stack.extend(node.orelse)
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            stack.extend(ast.iter_child_nodes(node))
    return names


def test_the_library_does_not_import_what_is_plugged_into_it() -> None:
    wrong = {}
    for path in sorted((ROOT / "coopsim").rglob("*.py")):
        if path.relative_to(ROOT / "coopsim").parts[0] in ("envs", "agents"):
            continue
        names = runtime_imports(ast.parse(path.read_text()))
        bad = [name for name in names if name.startswith(("coopsim.envs", "coopsim.agents", "envs", "agents"))]
        if bad:
            wrong[str(path.relative_to(ROOT))] = bad
    assert wrong == {}


def test_public_names_resolve() -> None:
    import coopsim

    for name in coopsim.__all__:
        assert getattr(coopsim, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'parallel_evn'"):
        _ = coopsim.parallel_evn
    assert "parallel_env" in dir(coopsim)


def test_readme_and_package_show_the_same_loop() -> None:
    """The first loop that a user reads is the one that runs in the tests."""
    import coopsim

    loop = (coopsim.__doc__ or "").split("```python\n")[1].split("```")[0]
    assert loop in (ROOT / "README.md").read_text()
