"""Maps are made, placed and fused where they belong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from street_scene import sweep_from  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.learn.weights import load_cooperative, load_detector  # noqa: E402
from coopsim.localization.recent_sweeps import aged  # noqa: E402
from coopsim.nn.inference.perceiver import Perceiver, PlacedMap, compass_region  # noqa: E402
from coopsim.types import PointCloud  # noqa: E402

CAR = (14.4, -7.2)


def perceiver(name: str = "fcooper", threads: int = 1) -> Perceiver:
    folder = weights_folder()
    detector = load_detector(folder / "pillars.safetensors")
    return Perceiver(detector, load_cooperative(folder / f"{name}.safetensors", detector), 7, threads)


def cloud(pose: Any, *cars: tuple[float, float]) -> np.ndarray:
    return aged(PointCloud.of(sweep_from(pose, cars)))


@pytest.mark.parametrize(
    ("heading_deg", "x_m", "y_m"),
    [(0, 100.8, 43.2), (90, 43.2, 100.8), (180, 100.8, 43.2), (-90, 43.2, 100.8), (45, 100.8, 100.8)],
)
def test_a_region_covers_the_rectangle_that_is_asked_for(heading_deg: float, x_m: float, y_m: float) -> None:
    region = compass_region((100.0, 40.0), np.radians(heading_deg), 1.2)
    assert region.x_m == pytest.approx((-x_m, x_m)) and region.y_m == pytest.approx((-y_m, y_m))
    assert all(cells % 8 == 0 for cells in region.shape)
    corners = np.array([[100, 40], [100, -40]]) @ np.array(
        [
            [np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))],
            [-np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))],
        ]
    )
    assert (np.abs(corners) <= [region.x_m[1], region.y_m[1]]).all()


def test_maps_are_the_same_for_any_number_of_threads() -> None:
    clouds = [cloud((x, 0, 0, 0), CAR) for x in (0.0, 5.0, 9.0)]
    for one, other in zip(perceiver().encode(clouds), perceiver(threads=3).encode(clouds[::1]), strict=True):
        np.testing.assert_array_equal(one.message.values, other.message.values)
        assert torch.equal(one.features, other.features)
        assert one.message.space == 7 and one.message.confidence is not None


@pytest.mark.parametrize("name", ["attfuse", "fcooper", "pyramid", "where2comm"])
def test_a_senders_car_arrives_where_it_stands(name: str) -> None:
    """A receiver that sees nothing; a sender 24 m east and 12 m north of it that sees a car."""
    network, sender = perceiver(name), (24.0, 12.0, 0.0, 0.0)
    own = network.encode([np.zeros((0, 5), np.float32)])[0]
    full, empty = (network.encode([cloud(sender, *cars)])[0].message for cars in ([CAR], []))
    region = compass_region((57.6, 38.4), 0.0, network.grid.cell_m)
    fused = []
    for message in (full, empty):
        placed = PlacedMap(network.receive(message), np.array([-sender[0], -sender[1], 0.0]), 0.0, 1)
        fused.append(network.fuse(own, region, [placed]).float())
    change = (fused[0] - fused[1]).abs().sum(0).numpy()
    row, column = np.unravel_index(np.argmax(change), change.shape)
    center = region.cell_centers()[row, column]
    assert change.max() > 0
    assert np.hypot(*(center - CAR)) < 3 * network.grid.cell_m
    far = np.hypot(*(region.cell_centers() - CAR).transpose(2, 0, 1)) > 12 * network.grid.cell_m
    assert change[far].max() < 0.2 * change.max()


def test_who_hears_nobody_has_its_own_map() -> None:
    network = perceiver()
    own = network.encode([cloud((0, 0, 0, 0), CAR)])[0]
    fused = network.fuse(own, network.grid, [])
    assert torch.equal(fused, own.features.to(fused.dtype))


def test_a_sender_out_of_reach_changes_nothing() -> None:
    network = perceiver()
    own, other = network.encode([cloud((0, 0, 0, 0), CAR), cloud((0, 0, 0, 0), CAR)])
    far = PlacedMap(network.receive(other.message), np.array([-500.0, 0.0, 0.0]), 0.1, 0)
    assert torch.equal(network.fuse(own, network.grid, [far]), network.fuse(own, network.grid, []))
