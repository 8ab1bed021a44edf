"""Every environment keeps gymnasium's rules for one agent, by gymnasium's own checkers; and its vectors take it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from representatives import all_of
from small_env import SIMULATED, SMALL

import coopsim
from coopsim.catalog import VERSIONED_NAMES
from coopsim.envs.wrappers import FixedSize, Flatten

UNBOUNDED = pytest.mark.filterwarnings("ignore:.*A Box observation space m..imum value is -?infinity")
"""Positions in the world have no bounds."""

TINY = SMALL | {"lidar_columns": 64, "max_cycles": 4}


def test_gymnasium_knows_every_environment() -> None:
    assert coopsim.ENVIRONMENTS.names() == VERSIONED_NAMES
    known = {name for name, spec in gymnasium.registry.items() if spec.namespace == "coopsim"}
    assert known == {f"coopsim/{name}" for name in VERSIONED_NAMES} | {"coopsim/drive-v1"}


@UNBOUNDED
@pytest.mark.parametrize("name", all_of(SIMULATED, "highway", "occluded_crossing", "town"))
def test_check_env(name: str) -> None:
    env = gymnasium.make(f"coopsim/{name}-v3", others="late_fusion", **TINY)
    check_env(env.unwrapped, skip_render_check=True)


@UNBOUNDED
@pytest.mark.parametrize(
    "options",
    [
        {"control": "policy"},
        {"control": "policy", "tracker": "late_fusion"},
        {"ego": "rsu_0", "others": None, "lidar": None},
        {"others": {"cav_1": "track_to_track", "cav_2": "no_fusion"}, "expose_ground_truth": True},
        {"sense_every": 2, "latency_s": 0.1, "localization": {"covariance_scale": 1.0}},
    ],
)
def test_check_env_with_options(options: dict[str, Any]) -> None:
    env = gymnasium.make("coopsim/crossing-v3", **(TINY | {"others": "late_fusion"} | options))
    check_env(env.unwrapped, skip_render_check=True)


@UNBOUNDED
def test_check_env_with_cameras() -> None:
    pytest.importorskip("moderngl")
    env = gymnasium.make("coopsim/crossing-v3", cameras="front", **TINY)
    check_env(env.unwrapped, skip_render_check=True)


@UNBOUNDED
def test_check_env_of_a_replay_with_its_pictures(recordings: Path) -> None:
    env = gymnasium.make(
        "coopsim/replay-v3", path=recordings, detections=("ego", "1"), others="late_fusion", expose_ground_truth=True
    )
    env.unwrapped.metadata["render_modes"].remove("human")  # there is no window here
    check_env(env.unwrapped)


@UNBOUNDED
def test_check_env_of_a_scenario_file() -> None:
    options = {key: value for key, value in TINY.items() if key != "vehicles"}
    env = gymnasium.make("coopsim/file-v3", path=coopsim.catalog.scenario_files()[0], **options)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", SIMULATED)
def test_what_make_wraps_finds_nothing_wrong_in_an_episode(name: str) -> None:
    """Gymnasium's passive checker warns, and a warning is an error here."""
    env = gymnasium.make(f"coopsim/{name}-v3", others="late_fusion", tracker="late_fusion", control="policy", **TINY)
    env.reset(seed=0)
    env.action_space.seed(0)
    steps, over = 0, False
    while not over:
        observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
        assert observation in env.observation_space
        over, steps = terminated or truncated, steps + 1
    assert steps == TINY["max_cycles"]


@pytest.mark.parametrize(
    ("mode", "vector_kwargs"),
    [
        ("sync", {}),
        ("async", {"shared_memory": False}),
        pytest.param("async", {"shared_memory": False, "context": "spawn"}, marks=pytest.mark.long),
    ],
)
def test_vectors_step_and_start_again(mode: str, vector_kwargs: dict[str, Any]) -> None:
    options = TINY | {"tracker": "late_fusion", "control": "policy", "others": coopsim.make_policy("late_fusion")}
    vector = gymnasium.make_vec(
        "coopsim/crossing-v3", num_envs=2, vectorization_mode=mode, vector_kwargs=vector_kwargs, **options
    )
    try:
        vector.reset(seed=[5, 6])
        steps = [vector.step(np.array([3, 4])) for _ in range(7)]
    finally:
        vector.close()
    assert [step[3].tolist() for step in steps] == [[k == 3] * 2 for k in range(7)]
    for k, seed in enumerate((5, 6)):  # each is what it would be alone
        env = coopsim.single_env("crossing", **options)
        env.reset(seed=seed)
        for step in steps[:4]:
            observation, reward, *_ = env.step(3 + k)
            assert step[1][k] == reward
            assert data_equivalence(step[0]["detections"][k], observation["detections"], exact=True)
            np.testing.assert_array_equal(step[0]["pose"][k], observation["pose"])


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vectors_of_boxes_need_no_options(mode: str) -> None:
    """Wrapped to fixed shapes, observations go through the shared memory that gymnasium uses if not told otherwise."""
    options = TINY | {"lidar": None, "tracker": "late_fusion", "control": "policy", "others": "late_fusion"}
    vector = gymnasium.make_vec(
        "coopsim/crossing-v3", num_envs=2, vectorization_mode=mode, wrappers=[FixedSize, Flatten], **options
    )
    try:
        observations, _ = vector.reset(seed=3)
        assert observations in vector.observation_space
        assert [observations.shape, observations.dtype] == [vector.observation_space.shape, np.float32]
        assert not np.array_equal(*observations)
        assert vector.step(vector.action_space.sample())[0] in vector.observation_space
    finally:
        vector.close()


def test_gymnasium_says_what_is_wrong_with_shared_memory() -> None:
    """Sequences have no fixed size: a wrapper that gives boxes, or shared_memory=False, is the answer."""
    with pytest.raises(TypeError, match="For `AsyncVectorEnv`, disable `shared_memory`"):
        gymnasium.make_vec("coopsim/crossing-v3", num_envs=1, vectorization_mode="async", **TINY)


@pytest.mark.filterwarnings("ignore:.*Using the latest versioned environment")
def test_an_id_without_a_version_is_the_newest() -> None:
    assert gymnasium.make("coopsim/crossing", **TINY).spec.id == "coopsim/crossing-v3"


@pytest.mark.filterwarnings("ignore:.*The environment coopsim/crossing-v0 is out of date")
@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("coopsim/crossing-v0", gymnasium.error.DeprecatedEnv, "use `coopsim/crossing-v3` instead"),
        ("coopsim/crosing-v1", gymnasium.error.NameNotFound, "Did you mean: `crossing`"),
    ],
)
def test_a_wrong_id_is_refused_with_a_hint(name: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        gymnasium.make(name)


@pytest.mark.parametrize(
    "program",
    [
        pytest.param(
            "import coopsim, gymnasium; env = gymnasium.make('coopsim/crossing-v3', lidar=None)", marks=pytest.mark.long
        ),
        "import gymnasium; env = gymnasium.make('coopsim:coopsim/crossing-v3', lidar=None)",
    ],
)
def test_importing_coopsim_is_enough(program: str) -> None:
    check = "; assert env.unwrapped.ego == 'cav_0'"
    subprocess.run([sys.executable, "-W", "error", "-c", program + check], check=True)


def test_importing_coopsim_loads_no_environment() -> None:
    program = "import coopsim, sys; print(*sys.modules, *sys.modules['gymnasium'].registry)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    loaded = set(done.stdout.split())
    assert "coopsim/crossing-v3" in loaded
    assert {"coopsim.envs", "pettingzoo", "highway_env", "numba", "matplotlib", "torch", "pygame"} & loaded == set()


def test_a_spec_can_be_written_down_and_read(tmp_path: Path) -> None:
    spec = gymnasium.make("coopsim/crossing-v3", ego="cav_1", others="late_fusion", **TINY).spec
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert again.unwrapped.ego == "cav_1" and set(again.unwrapped.policies) == {"cav_0", "cav_2", "rsu_0"}
