"""Maps are made, placed and fused where they belong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from street_scene import sweep_from, view_of  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.learn.weights import load_cooperative, load_detector  # noqa: E402
from coopsim.nn.cooperative.perceiver import OwnMap, Perceiver, PlacedMap  # noqa: E402
from coopsim.nn.cooperative.warp import warp  # noqa: E402
from coopsim.nn.inference.backend import Backend  # noqa: E402
from coopsim.nn.inference.canvas import compass_region, way_to_world_cells  # noqa: E402
from coopsim.nn.inference.encoders import PointEncoder  # noqa: E402
from coopsim.types import Sweep  # noqa: E402

CAR = (14.4, -7.2)


def perceiver(name: str = "fcooper", threads: int = 1) -> Perceiver:
    folder = weights_folder()
    detector = load_detector(folder / "pillars.safetensors")
    net = load_cooperative(folder / f"{name}.safetensors", detector)
    return Perceiver(net, detector.config.cell_m, 7, Backend(threads=threads))


def maps(network: Perceiver, sweeps: list[Sweep], places: Any = None) -> list[OwnMap]:
    encoder = PointEncoder(load_detector(weights_folder() / "pillars.safetensors"))
    frames = [encoder.take(view_of(sweep)) for sweep in sweeps]
    where = [np.zeros(2)] * len(frames) if places is None else places
    return network.encode([replace(each, position_m=place) for each, place in zip(frames, where, strict=True)])


def cloud(pose: Any, *cars: tuple[float, float]) -> Sweep:
    return sweep_from(pose, cars)


@pytest.mark.parametrize(
    ("heading_deg", "x_m", "y_m"),
    [(0, 100.8, 43.2), (90, 43.2, 100.8), (180, 100.8, 43.2), (-90, 43.2, 100.8), (45, 100.8, 100.8)],
)
def test_a_region_covers_the_rectangle_that_is_asked_for(heading_deg: float, x_m: float, y_m: float) -> None:
    region = compass_region((100.0, 40.0), np.radians(heading_deg), 1.2)
    assert region.x_m == pytest.approx((-x_m, x_m)) and region.y_m == pytest.approx((-y_m, y_m))
    assert all(cells % 4 == 0 for cells in region.shape)
    corners = np.array([[100, 40], [100, -40]]) @ np.array(
        [
            [np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))],
            [-np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))],
        ]
    )
    assert (np.abs(corners) <= [region.x_m[1], region.y_m[1]]).all()


@pytest.mark.parametrize("heading_deg", [0, 30, 90])
def test_a_region_on_the_worlds_cells_still_covers_the_rectangle(heading_deg: float) -> None:
    for position in np.random.default_rng(0).uniform(-500, 500, (20, 2)):
        way = way_to_world_cells(position, 1.2)
        region = compass_region((50.0, 20.0), np.radians(heading_deg), 1.2, way)
        turn = np.array([np.exp(1j * np.radians(heading_deg))]).view(float)
        corners = [complex(x, y) * complex(*turn) for x in (-50, 50) for y in (-20, 20)]
        assert (
            min(c.real for c in corners) >= region.x_m[0] - 1e-6
            and max(c.imag for c in corners) <= region.y_m[1] + 1e-6
        )
        edges = (np.array([region.x_m[0], region.y_m[0]]) + position) / 4.8
        np.testing.assert_allclose(edges, np.round(edges), atol=1e-9)


def test_what_two_agents_see_alike_is_alike_in_the_cells_of_their_maps() -> None:
    """The same points around the same car, encoded around two places: a warp copies cells."""
    network, places = perceiver(), [np.array([3.1, -7.7]), np.array([-21.3, 11.9])]
    points = np.random.default_rng(0).normal([CAR[0], CAR[1], 1.0], [2, 1, 0.3], (300, 3))
    like = (np.full(300, 0.3, np.float32), np.zeros(300, np.int64))
    sweeps = [Sweep((points - [*place, 0]).astype(np.float32), *like) for place in places]
    one, other = maps(network, sweeps, places)
    offset = np.array([*(places[0] - places[1]), 0.0])
    grid = one.message.grid
    moved, _ = warp(torch.tensor(other.message.values)[None], other.message.grid, grid, offset)
    near = np.hypot(*(grid.cell_centers() + places[0] - CAR).transpose(2, 0, 1)) < 15
    shown = one.message.values[:, near]
    np.testing.assert_allclose(moved[0].numpy()[:, near], shown, atol=0.02 * np.abs(shown).max())
    assert shown.std(axis=1).max() > 0


def test_maps_are_the_same_for_any_number_of_threads() -> None:
    clouds = [cloud((x, 0, 0, 0), CAR) for x in (0.0, 5.0, 9.0)]
    for one, other in zip(maps(perceiver(), clouds), maps(perceiver(threads=3), clouds), strict=True):
        np.testing.assert_array_equal(one.message.values, other.message.values)
        assert torch.equal(one.features, other.features)
        assert one.message.space == 7 and one.message.confidence is not None


@pytest.mark.parametrize(
    "name",
    ["attfuse", "cobevt", "disconet", "fcooper", "ff_tracking", "gsaf", "pyramid", "v2vnet", "v2x_vit", "where2comm"],
)
def test_a_senders_car_arrives_where_it_stands(name: str) -> None:
    """A receiver that sees nothing; a sender 24 m east and 12 m north of it that sees a car."""
    network, sender = perceiver(name), (24.0, 12.0, 0.0, 0.0)
    own = maps(network, [Sweep.empty()])[0]
    full, empty = (maps(network, [cloud(sender, *cars)])[0].message for cars in ([CAR], []))
    region = compass_region((57.6, 38.4), 0.0, network.cell_m)
    fused = []
    for message in (full, empty):
        placed = PlacedMap(network.receive(message), np.array([-sender[0], -sender[1], 0.0]), 0.0, 1)
        fused.append(network.fuse(own, region, [placed]).float())
    change = (fused[0] - fused[1]).abs().sum(0).numpy()
    row, column = np.unravel_index(np.argmax(change), change.shape)
    center = region.cell_centers()[row, column]
    assert change.max() > 0
    assert np.hypot(*(center - CAR)) < 3 * network.cell_m
    far = np.hypot(*(region.cell_centers() - CAR).transpose(2, 0, 1)) > 12 * network.cell_m
    assert change[far].max() < 0.2 * change.max()


def test_fusions_are_told_who_receives_and_who_sends(monkeypatch: pytest.MonkeyPatch) -> None:
    network, told = perceiver(), []
    own, other = maps(network, [cloud((0, 0, 0, 0), CAR), cloud((0, 0, 0, 0), CAR)])
    fuse = type(network._net.fusion).fuse
    monkeypatch.setattr(type(network._net.fusion), "fuse", lambda *given: told.append(given[-1]) or fuse(*given))
    placed = PlacedMap(network.receive(other.message), np.zeros(3), 0.25, 2)
    network.fuse(own, own.message.grid, [placed])
    network.fuse(own, own.message.grid, [placed], own_kind=1)
    assert [(each.own_kind, each.kind.tolist(), each.delay_s.tolist()) for each in told] == [
        (0, [2], [0.25]),
        (1, [2], [0.25]),
    ]


def test_who_hears_nobody_has_its_own_map() -> None:
    network = perceiver()
    own = maps(network, [cloud((0, 0, 0, 0), CAR)])[0]
    fused = network.fuse(own, own.message.grid, [])
    assert torch.equal(fused, own.features.to(fused.dtype))


def test_a_sender_out_of_reach_changes_nothing() -> None:
    network = perceiver()
    own, other = maps(network, [cloud((0, 0, 0, 0), CAR), cloud((0, 0, 0, 0), CAR)])
    far = PlacedMap(network.receive(other.message), np.array([-500.0, 0.0, 0.0]), 0.1, 0)
    assert torch.equal(network.fuse(own, own.message.grid, [far]), network.fuse(own, own.message.grid, []))
