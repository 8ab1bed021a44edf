"""Agents with other sensors make maps that lie alike, and understand each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from lit_pictures import CAMERAS, lit_view  # noqa: E402
from street_scene import spec_of, sweep_from, view_of  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.learn.weights import load_cooperative, load_detector, load_pictures  # noqa: E402
from coopsim.nn.camera.picture_batch import PictureView, collate_pictures  # noqa: E402
from coopsim.nn.cooperative.perceiver import OwnMap, Perceiver, PlacedMap  # noqa: E402
from coopsim.nn.inference.backend import PROCESSOR, Backend  # noqa: E402
from coopsim.nn.inference.canvas import compass_region  # noqa: E402
from coopsim.nn.inference.detectors import ViewDetector  # noqa: E402
from coopsim.nn.inference.encoders import MixedEncoder, PictureEncoder, PointEncoder, pictures_of  # noqa: E402  # noqa: E402
from coopsim.types import BevGrid, SensorView, Sweep  # noqa: E402

LIGHT = (14.4, -7.2)


def detector() -> Any:
    return load_detector(weights_folder() / "pillars.safetensors")


def picture_net() -> Any:
    return load_pictures(weights_folder() / "lift_splat.safetensors", detector())


def encoder() -> MixedEncoder:
    return MixedEncoder(PointEncoder(detector()), PictureEncoder(picture_net()))


def perceiver(name: str = "fcooper", threads: int = 1) -> Perceiver:
    net = load_cooperative(weights_folder() / f"{name}.safetensors", detector())
    return Perceiver(net, detector().config.cell_m, 7, Backend(threads=threads))


def maps(network: Perceiver, *views: SensorView) -> list[OwnMap]:
    return network.encode([replace(encoder().take(view), position_m=np.zeros(2)) for view in views])


def hottest(map_of: OwnMap, dark: OwnMap) -> np.ndarray[Any, Any]:
    """The middle of the cell whose features differ most from those of a dark picture."""
    change = (map_of.features.float() - dark.features.float()).abs().sum(0).numpy()
    assert change.max() > 0
    place: np.ndarray[Any, Any] = map_of.message.grid.cell_centers()[np.unravel_index(change.argmax(), change.shape)]
    return place


@pytest.mark.parametrize("yaw_deg", [0, 40, 180])
@pytest.mark.parametrize("light", [LIGHT, (-9.6, 12.0), (0.0, 16.8)])
def test_a_light_lies_where_it_is_in_the_compass_frame(yaw_deg: float, light: tuple[float, float]) -> None:
    network = perceiver()
    lit, dark = maps(network, *(lit_view(*each, yaw_rad=np.radians(yaw_deg)) for each in ([light], [])))
    assert np.hypot(*(hottest(lit, dark) - light)) < 3 * network.cell_m


@pytest.mark.parametrize("name", ["attfuse", "cobevt", "fcooper", "pyramid", "v2x_vit"])
def test_what_cameras_see_reaches_an_agent_with_a_lidar(name: str) -> None:
    """And the other way round: a receiver that sees nothing, and a sender of the other kind, 24 m west of it."""
    network = perceiver(name)
    lit, dark, no_points = maps(network, lit_view(LIGHT), lit_view(), view_of(Sweep.empty()))
    car, street = maps(network, view_of(sweep_from((0, 0, 0, 0), [LIGHT])), view_of(sweep_from((0, 0, 0, 0), [])))
    region = compass_region((57.6, 38.4), 0.0, network.cell_m)
    for own, with_it, without in ((no_points, lit, dark), (dark, car, street)):
        fused = []
        for sent in (with_it, without):
            placed = PlacedMap(network.receive(sent.message), np.array([24.0, 0.0, 0.0]), 0.0, 1)
            fused.append(network.fuse(own, region, [placed]).float())
        change = (fused[0] - fused[1]).abs().sum(0).numpy()
        assert change.max() > 0
        found = region.cell_centers()[np.unravel_index(change.argmax(), change.shape)]
        assert np.hypot(*(found - LIGHT + [24.0, 0.0])) < 4 * network.cell_m


def test_each_agent_is_encoded_by_what_it_has() -> None:
    network, lidar = perceiver(), spec_of("cav_0").lidars
    points, pictures = view_of(sweep_from((0, 0, 0, 0))), lit_view(LIGHT)
    both = replace(pictures, sweeps=points.sweeps, lidars=lidar)
    neither = SensorView("cav_1", 0, points.odometry)
    got = maps(network, replace(points, lidars=lidar), both, neither)
    taken = [PointEncoder(detector()).take(each) for each in (points, both, view_of(Sweep.empty()))]
    expected = network.encode([replace(each, position_m=np.zeros(2)) for each in taken])
    for one, other in zip(got, expected, strict=True):
        assert torch.equal(one.features, other.features)
        np.testing.assert_array_equal(one.message.values, other.message.values)


def test_maps_are_the_same_for_any_number_of_threads() -> None:
    views = [lit_view(LIGHT), view_of(sweep_from((0, 0, 0, 0))), lit_view((9.6, 4.8)), lit_view()]
    for one, other in zip(maps(perceiver(), *views), maps(perceiver(threads=3), *views), strict=True):
        assert torch.equal(one.features, other.features)
        np.testing.assert_array_equal(one.message.values, other.message.values)


def test_an_encoder_of_pictures_for_inference_gives_the_same_features() -> None:
    net, draw = picture_net_with_norms(), BevGrid((-38.4, 38.4), (-38.4, 38.4), 2.4)
    encoder = PictureEncoder(net)
    batch = collate_pictures([PictureView(pictures_of(lit_view(LIGHT)), np.zeros(3), draw)])
    with PROCESSOR.inference():
        got = encoder.encode([encoder.take(lit_view(LIGHT))], [draw]).float()
    with torch.no_grad():
        expected = net.encoder(batch)
    assert expected.abs().max() > 0
    torch.testing.assert_close(got, expected, rtol=0.05, atol=0.05 * float(expected.abs().max()))
    assert not any(isinstance(each, torch.nn.BatchNorm2d) for each in encoder._encoder.modules())


def picture_net_with_norms() -> Any:
    """A network whose normalisations are not trivial."""
    net, draw = load_pictures(weights_folder() / "lift_splat.safetensors"), torch.Generator().manual_seed(1)
    net = type(net)(net.config).eval().requires_grad_(False)
    for name, value in net.state_dict().items():
        if "running_mean" in name:
            value.normal_(0, 0.1, generator=draw)
        elif "running_var" in name:
            value.uniform_(0.5, 2.0, generator=draw)
    return net


def test_a_finder_finds_lights_by_some_cameras_and_nothing_without() -> None:
    net = picture_net()
    finder = ViewDetector(PictureEncoder(net), net.head, net.config.cell_m, Backend(threads=2))
    some = lit_view(LIGHT, cameras=["camera_0", "camera_3"])
    found, dark, blind = finder.detect_around([some, lit_view(), replace(some, images={})], 38.4, 0.3)
    assert len(found) and found.covariance is not None
    assert np.hypot(*(found.boxes.center[0, :2] - LIGHT)) < 6.0
    assert len(dark) == len(blind) == 0
    away = lit_view(LIGHT, cameras=["camera_2"])  # it looks the other way
    assert len(finder.detect_around([away], 38.4, 0.3)[0]) == 0


def test_pictures_without_colours_are_refused_and_missing_ones_are_not() -> None:
    with pytest.raises(InvalidValueError, match=r"camera 'camera_0' of rsu_0 has none: .* \"rgb\" among camera_modes"):
        pictures_of(lit_view(modes="depth"))
    whole = lit_view(LIGHT)
    assert [len(pictures_of(each)) for each in (whole, replace(whole, images={}))] == [len(CAMERAS), 0]
