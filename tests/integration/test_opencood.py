"""OpenCOOD itself, unchanged, reads an export: points, truth, and three of its PointPillars models run through.

Runs where `COOPSIM_OPENCOOD` names a checkout whose needs are installed beside coopsim (docs/reference/export.md).
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.data.export.opv2v_format import OBJECT_NUMBER
from coopsim.data.files.carla_axes import mirror
from coopsim.types import ObjectClass

CHECKOUT = os.environ.get("COOPSIM_OPENCOOD")

pytestmark = [
    pytest.mark.skipif(not CHECKOUT, reason="COOPSIM_OPENCOOD names no checkout"),
    pytest.mark.filterwarnings("ignore"),  # of theirs
]

SEED, FRAMES = 5, 2
LEAST_M, MOST_M = (-139.9, -39.9, -2.9), (139.9, 39.9, 0.9)
"""Boxes with a corner beyond x, y, z of -140, -40, -3 to 140, 40, 1 m from the ego's LiDAR are not in its truth."""

OPTIONS = {"vehicles": 20, "rsus": 1, "position_noise_m": 0.3}
DROPPED = {"int": int, "float": float, "bool": bool, "Inf": np.inf}
"""What numpy has dropped since OpenCOOD was written."""

MODELS = {
    "point_pillar_late_fusion": "inference_late_fusion",
    "point_pillar_early_fusion": "inference_early_fusion",
    "point_pillar_intermediate_fusion": "inference_intermediate_fusion",  # AttFuse
}


@pytest.fixture(scope="module")
def opencood() -> Iterator[dict[str, ModuleType]]:
    import matplotlib

    modules = "data_utils.datasets", "hypes_yaml.yaml_utils", "tools.inference_utils", "utils.transformation_utils"
    with pytest.MonkeyPatch.context() as patch:
        for name, value in DROPPED.items():
            if name not in np.__dict__:
                patch.setattr(np, name, value, raising=False)
        if not hasattr(matplotlib.cm, "get_cmap"):
            patch.setattr(matplotlib.cm, "get_cmap", matplotlib.colormaps.__getitem__, raising=False)
        patch.syspath_prepend(str(CHECKOUT))
        yield {name.rpartition(".")[2]: importlib.import_module(f"opencood.{name}") for name in modules}


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opencood") / "out"
    return coopsim.export("opv2v", "crossing", folder, seeds=(SEED,), frames=FRAMES, **OPTIONS)


@pytest.fixture(scope="module")
def frames() -> list[Any]:
    env = coopsim.parallel_env("crossing", expose_ground_truth=True, detector="none", **OPTIONS)
    return [frame for frame, _ in zip(env.frames(SEED), range(FRAMES), strict=False)]


def _dataset(opencood: dict[str, ModuleType], folder: Path, config: str) -> tuple[dict[str, Any], Any]:
    hypes = opencood["yaml_utils"].load_yaml(str(Path(str(CHECKOUT), "opencood", "hypes_yaml", f"{config}.yaml")))
    hypes |= {"root_dir": str(folder), "validate_dir": str(folder)}
    return hypes, opencood["datasets"].build_dataset(hypes, visualize=False, train=False)


def _model(config: dict[str, Any]) -> Any:
    """The model of a configuration, untrained, as their `create_model` finds it; its module needs more than models."""
    module = importlib.import_module(f"opencood.models.{config['core_method']}")
    wanted = config["core_method"].replace("_", "")
    (made,) = (each for name, each in vars(module).items() if name.lower() == wanted)
    return made(config["args"])


def _folder(name: str, actor_id: int | None) -> str:
    return "-1" if actor_id is None else str(OBJECT_NUMBER + actor_id)


def test_its_data_set_gives_the_points_and_poses_that_were_exported(opencood, exported, frames):
    _, dataset = _dataset(opencood, exported, "point_pillar_intermediate_fusion")
    assert len(dataset) == FRAMES
    to_world = opencood["transformation_utils"].x_to_world
    for index, frame in enumerate(frames):
        base = dataset.retrieve_base_data(index)
        assert {name for name, content in base.items() if content["ego"]} == {min(name for name in base if name > "0")}
        agents = {_folder(name, agent.body.actor_id): agent for name, agent in frame.agents.items()}
        assert set(base) == set(agents)
        for name, agent in agents.items():
            (sweep,) = agent.observation.sweeps.values()
            points = base[name]["lidar_np"]
            world = np.column_stack([points[:, :3], np.ones(len(points))])
            world = world @ to_world(base[name]["params"]["lidar_pose"]).T
            truth = mirror(agent.body.world_SE3_base.apply(sweep.points))
            np.testing.assert_allclose(world[:, :3], truth, atol=1e-3)
            np.testing.assert_allclose(points[:, 3], sweep.intensity, atol=1 / 255)


def test_its_truth_is_that_of_the_simulation(opencood, exported, frames):
    _, dataset = _dataset(opencood, exported, "point_pillar_intermediate_fusion")
    for index, frame in enumerate(frames):
        base = dataset.retrieve_base_data(index)
        ego = next(content for content in base.values() if content["ego"])
        found, mask, ids = dataset.post_processor.generate_object_center(
            list(base.values()), ego["params"]["lidar_pose"]
        )
        found = dict(zip(ids, found[mask > 0], strict=True))
        hit = set().union(*(set(np.unique(agent.instances["lidar"])) for agent in frame.agents.values()))
        (sensing,) = (
            agent for agent in frame.agents.values() if agent.body.actor_id == min(found_ids(frame)) - OBJECT_NUMBER
        )
        lidar_m = sensing.body.world_SE3_base.apply([0, 0, sensing.body.height_m + 0.35])
        expected = {}
        for row, number in enumerate(frame.actors.id.tolist()):
            corners = sensing.body.world_SE3_base.inverse().rotate(frame.actors.boxes.corners[row] - lidar_m)
            inside = ((corners > LEAST_M) & (corners < MOST_M)).all()
            if number in hit and frame.actors.label[row] <= ObjectClass.BUS and inside:
                expected[OBJECT_NUMBER + number] = row
        assert len(expected) > 5
        assert set(expected) <= set(found)
        for number, row in expected.items():
            x, y, z, h, w, l, yaw = found[number]  # noqa: E741
            yaw_rad = frame.actors.boxes.yaw[row] - sensing.body.world_SE3_base.yaw
            place = sensing.body.world_SE3_base.inverse().rotate(frame.actors.boxes.center[row] - lidar_m)
            np.testing.assert_allclose([x, y, z], mirror(place), atol=1e-3)
            np.testing.assert_allclose([l, w, h], frame.actors.boxes.size[row], atol=1e-3)
            assert np.cos(yaw + yaw_rad) == pytest.approx(1.0, abs=1e-6)


def found_ids(frame) -> list[int]:
    """The numbers of the connected cars, of which the least is the ego."""
    return [OBJECT_NUMBER + each.body.actor_id for each in frame.agents.values() if each.body.actor_id is not None]


@pytest.mark.parametrize("config", MODELS)
def test_its_models_run_through(opencood, exported, config):
    import torch

    hypes, dataset = _dataset(opencood, exported, config)
    torch.manual_seed(0)
    model = _model(hypes["model"]).eval()
    batch = dataset.collate_batch_test([dataset[FRAMES - 1]])
    with torch.no_grad():
        raw = [model(content) for content in batch.values()]
        _, _, truth = getattr(opencood["inference_utils"], MODELS[config])(batch, model, dataset)
    for outputs in raw:
        assert torch.isfinite(outputs["psm"]).all()
        assert torch.isfinite(outputs["rm"]).all()
    assert len(truth) > 5
