"""The rooms of the world form no circle, and highway-env stays in its wing."""

import subprocess
import sys

from import_graph import circles, file_graph, module_files

FILES = module_files()
WING = "coopsim.world.traffic.highway_reference"


def _folder(module: str) -> str:
    """Return the folder of a module of the world; a loose file is one by itself."""
    return module if FILES[module].name == "__init__.py" or module.count(".") < 3 else module.rpartition(".")[0]


def test_no_circle_among_the_folders_of_the_world() -> None:
    graph: dict[str, set[str]] = {}
    for name, imported in file_graph().items():
        if name.startswith("coopsim.world."):
            inside = {_folder(other) for other in imported if other.startswith("coopsim.world.")}
            graph.setdefault(_folder(name), set()).update(inside - {_folder(name)})
    assert circles(graph) == []
    assert not {name for name, others in graph.items() if WING in others}  # it is imported when it is asked for


def test_highway_env_is_loaded_only_when_its_traffic_is_asked_for() -> None:
    code = """
import sys
import coopsim
env = coopsim.parallel_env("crossing", traffic=sys.argv[1], vehicles=3, pedestrians=0, lidar=None)
env.reset(seed=0)
print("highway_env" in sys.modules)
"""
    for traffic, expected in (("arrays", "False"), ("highway-env", "True")):
        run = subprocess.run([sys.executable, "-c", code, traffic], capture_output=True, text=True, check=True)
        assert run.stdout.split()[-1] == expected
