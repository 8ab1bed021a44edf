"""Installed packages add places, situations, recordings, protocols and commands by name, through entry points."""

from __future__ import annotations

from pathlib import Path

import pytest
from fork_server import run_python

PLUGIN = '''
from pathlib import Path

from coopsim.bench.detect.protocols import CoopsimProtocol
from coopsim.cli.arguments import Command
from coopsim.data.single_car.array_folder import ArrayFolder
from coopsim.world.places.crossings import make_crossing
from coopsim.world.population import Population
from coopsim.world.scenario import Place
from coopsim.world.situations.crossings import CrossingPath

place = Place("square", make_crossing, Population(vehicles=5, pedestrians=0))


class Staged(CrossingPath):
    """Stage it as I like."""

    name = "staged"


class MyFolder(ArrayFolder):
    """Arrays of mine."""

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return (path / "mine.txt").is_file()

    @property
    def sequences(self) -> tuple[str, ...]:
        return ("drive",)


class MyProtocol(CoopsimProtocol):
    """Count as I do."""


def say_hello(options):
    print(f"hello {options.to}")
    return 0


command = Command("say hello", lambda parser: parser.add_argument("--to"), say_hello)
'''

ENTRY_POINTS = """
[coopsim.places]
square = plugged_in:place
[coopsim.situations]
staged = plugged_in:Staged
[coopsim.recordings]
mine = plugged_in:MyFolder
[coopsim.protocols]
mine = plugged_in:MyProtocol
[coopsim.commands]
greet = plugged_in:command
broken = no_such_module:command
odd = plugged_in:say_hello
"""

PROGRAM = """
import contextlib, io, sys
from pathlib import Path

import coopsim
from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.cli.entry import COMMANDS, main
from coopsim.recordings.formats import RECORDINGS, find_format, open_folder

def told(*words):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as error:
            status = error.code
    return status, out.getvalue() + err.getvalue()

def refused(does, *known):
    try:
        does()
    except coopsim.CoopsimError as error:
        assert all(name in str(error) for name in known), error
    else:
        raise AssertionError("a typo was accepted")

assert {"square-v3", "staged-v3"} <= set(coopsim.ENVIRONMENTS.names())
assert "mine" in RECORDINGS and "mine" in PROTOCOLS and "greet" in COMMANDS
assert "plugged_in" not in sys.modules  # names are known without loading anything

status, text = told("greet", "--to", "Ada")
assert (status, text) == (0, "hello Ada\\n"), text
status, text = told("greed")
assert status == 2 and "greet" in text and "bench" in text, text
status, text = told("--help")
assert status == 0 and "greet" in text and "broken" in text, text  # a broken one costs itself alone
status, text = told("broken", "--to", "Ada")
assert status == 2 and text == (
    "coopsim: error: package 'plugged-in', entry point 'no_such_module:command' raised ModuleNotFoundError: "
    "No module named 'no_such_module'\\n"
), text
status, text = told("odd")
assert status == 2 and "package 'plugged-in'" in text and "must be a coopsim.cli.arguments.Command" in text, text
assert told("list", "broken")[0] == 2 and "unknown kind 'broken'" in told("list", "broken")[1]

for name in ("square", "staged"):
    env = coopsim.parallel_env(name, lidar=None, max_cycles=1)
    assert env.metadata["name"] == f"coopsim/{name}-v3", env.metadata
refused(lambda: coopsim.parallel_env("squire"), "square-v3")
refused(lambda: coopsim.parallel_env("stagedd"), "staged-v3")
assert "square" in told("list", "places")[1] and "Stage it as I like" in told("list", "situations")[1]

folder = Path(sys.argv[1])
assert find_format(folder) == "mine" and type(open_folder(folder)).__name__ == "MyFolder"
refused(lambda: open_folder(folder, name="mime"), "mine", "opv2v")
refused(lambda: coopsim.parallel_env(folder, format="mime"), "mine", "text")
assert "Arrays of mine" in told("list", "recordings")[1]

assert PROTOCOLS.get("mine").__module__ == "plugged_in" and "Count as I do" in told("list", "protocols")[1]
status, text = told("detect", "--protocol", "mime", "--seeds", "0-0", "--frames", "1")
assert status == 2 and "mine" in text and "opencood" in text, text
"""


@pytest.mark.usefixtures("started_anew")
def test_packages_dock_places_situations_recordings_protocols_and_commands(tmp_path: Path) -> None:
    recorded = tmp_path / "recorded"
    recorded.mkdir()
    (recorded / "mine.txt").touch()
    (tmp_path / "plugged_in.py").write_text(PLUGIN)
    info = tmp_path / "plugged_in-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged-in\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    done = run_python(PROGRAM, str(recorded), found=tmp_path)
    assert done.returncode == 0, done.stderr
