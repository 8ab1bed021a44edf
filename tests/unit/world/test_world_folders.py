"""The rooms of the world form no circle, and highway-env stays in its file."""

from fork_server import run_python
from import_graph import circles, file_graph, folder_graph

WING = "coopsim.world.traffic.highway_env_engine"


def test_no_circle_among_the_folders_of_the_world() -> None:
    assert circles(folder_graph("coopsim.world", loose_apart=True)) == []
    assert not {name for name, others in file_graph().items() if WING in others}  # it is imported when it is asked for


def test_highway_env_is_loaded_only_when_its_traffic_is_asked_for() -> None:
    code = """
import sys
import coopsim
for traffic in ("arrays", "highway-env"):
    env = coopsim.parallel_env("crossing", traffic=traffic, vehicles=3, pedestrians=0, lidar=None)
    env.reset(seed=0)
    print("highway_env" in sys.modules)
"""
    run = run_python(code)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split()[-2:] == ["False", "True"]
