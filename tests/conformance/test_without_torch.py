"""Without torch everything works that needs none, and what needs it says how to install it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HIDE = """
import sys
for name in ("torch", "safetensors"):
    sys.modules[name] = None  # as if it were not installed
import coopsim
"""


def run(program: str) -> str:
    """Run a program without torch, in a process of its own. Return its output."""
    done = subprocess.run([sys.executable, "-c", HIDE + program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_learned_policies_and_detectors_name_the_extra() -> None:
    run("""
from coopsim.errors import MissingDependencyError
RANKINGS = ["learned", "learned(weights=mine.safetensors)"]
for make, names in (
    (coopsim.make_policy, ("early", "fcooper", "attfuse", "where2comm", "pyramid", "gsaf", "dmstrack", "yoloo")),
    (coopsim.make_policy, ("cooptrack", "univ2x", "vic_integrated")),
    (lambda name: coopsim.parallel_env("crossing", detector=name), ("pillars", "lift_splat", "points_and_pictures")),
    (lambda name: coopsim.parallel_env("crossing", lidar=None, budget_bytes=99, selection=name).reset(), RANKINGS),
    (lambda name: coopsim.make_policy("dino_codt_tracking", embedder=name), ("picture_identity", "dinov2(model=mine)")),
):
    for name in names:
        try:
            make(name)
        except MissingDependencyError as error:
            assert "pip install 'coopsim[learn]'" in str(error), (name, error)
        else:
            raise AssertionError(name)
""")


def test_other_policies_run_and_all_names_are_listed() -> None:
    shown = run("""
from coopsim.cli.entry import main
assert main(["list"]) == 0
coopsim.evaluate("late_fusion", "crossing", lidar=None, max_cycles=2)
""")
    assert "attfuse" in shown and "late_fusion" in shown


def test_training_names_the_extra() -> None:
    program = """
from coopsim.cli.entry import main
code = main(["train", "pillars", "--out", "nowhere"])
assert code != 0, code
"""
    done = subprocess.run([sys.executable, "-c", HIDE + program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "pip install 'coopsim[learn]'" in done.stderr and "Traceback" not in done.stderr


def test_the_example_that_trains_names_the_extra() -> None:
    example = Path(__file__).parents[2] / "examples" / "18_train_your_own_fusion.py"
    shown = run(f"import runpy; runpy.run_path({str(example)!r})")
    assert shown == "this example needs torch: pip install 'coopsim[learn]'\n"
