"""pyrender is the cameras' reference: the other renderers see what it sees, and it leaves theirs alone."""

from __future__ import annotations

import gc
import subprocess
import sys
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from sensor_scenes import Studio, actors, soup
from test_renderers import BODIES, DISTORTED, PLACES, STATIC, assert_same, small, stacked

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera, agent_rigs
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import MODES
from coopsim.sensors.camera.renderer import Renderer
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

TINY = Camera("front", Intrinsics.from_fov(33, 21))
TRIANGLE = soup(np.array([[[-9.0, -8.0, 4.0], [9.0, -8.0, 4.0], [0.0, 12.0, 4.0]]]))
"""Across the optical axis of a camera in the world's axes, which looks up."""


@pytest.fixture
def pyrender() -> Renderer:
    return opened("pyrender")


def opened(name: str) -> Renderer:
    try:
        return make_renderer(name)
    except MissingDependencyError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("lens", ["pinhole", *DISTORTED])
@pytest.mark.parametrize("other", ["opengl", "raycast"])
def test_a_crossing_looks_the_same(other: str, lens: str) -> None:
    """Its depths are of a 24-bit buffer, and fine to 5 cm as far as a crossing ranges_to_boxes."""
    world = World(make_scenario("crossing"), seed=5)
    bodies = world.agents()
    intrinsics = Intrinsics.from_fov(160, 90, distortion=DISTORTED.get(lens, (0.0,) * 5))
    named = agent_rigs("surround", {name: body.kind for name, body in bodies.items()})
    rigs = {name: [replace(camera, intrinsics=intrinsics) for camera in rig] for name, rig in named.items()}
    studios = [Studio(renderer, world.static, world.models, rigs, modes=MODES) for renderer in ("pyrender", other)]
    reference, seen = (stacked(studio.shoot(world.actors(), bodies)) for studio in studios)
    for studio in studios:
        studio.rig.close()
    # Rays go where the lens looks; the others draw a finer pinhole's picture, whose edges may be a quarter pixel off.
    exact = lens == "pinhole" or other == "opengl"
    assert len(np.unique(reference["instance"])) > 5 and len(np.unique(reference["semantic"])) > 2
    assert (np.abs(seen["depth"] - reference["depth"]) <= 0.05).mean() >= (0.999 if exact else 0.99)
    assert (seen["instance"] == reference["instance"]).mean() >= (0.999 if exact else 0.99)
    assert (seen["semantic"] == reference["semantic"]).mean() >= (0.999 if exact else 0.99)
    moving = reference["instance"] > 0  # alone: the ground and the sky agree too easily
    assert (seen["instance"] == reference["instance"])[moving].mean() >= (0.99 if exact else 0.94)


@pytest.mark.parametrize("lens", [TINY.intrinsics, replace(TINY.intrinsics, distortion=DISTORTED["barrel"])])
@pytest.mark.parametrize("below", [True, False])
def test_a_triangle_is_seen_from_either_side(pyrender: Renderer, below: bool, lens: Intrinsics) -> None:
    """As rays and OpenGL see it; pyrender would leave out what looks away."""
    pose = SE3.identity() if below else SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 8.0]))
    pyrender.update(TRIANGLE)
    view = pyrender.see(replace(TINY, intrinsics=lens), pose, None)
    pyrender.close()
    assert (view.face == 0).any() and (view.face == -1).any()
    np.testing.assert_allclose(view.depth, np.where(view.face == 0, 4.0, 0.0), atol=1e-3)


def test_where_there_is_nothing_it_sees_nothing(pyrender: Renderer) -> None:
    pyrender.update(soup(np.zeros((0, 3, 3))))
    view = pyrender.see(TINY, SE3.identity(), None)
    assert (view.face == -1).all() and (view.depth == 0).all()
    pyrender.update(replace(TRIANGLE, instance=np.array([7])))
    assert (pyrender.see(TINY, SE3.identity(), 7).face == -1).all()
    pyrender.close()


def test_more_triangles_than_it_can_number_are_refused(pyrender: Renderer) -> None:
    many = replace(TRIANGLE, faces=np.broadcast_to(TRIANGLE.faces, (2**23, 3)))
    with pytest.raises(InvalidValueError, match="at most 8388607 triangles here, got 8388608"):
        pyrender.update(many)
    pyrender.close()


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_renderers_close_in_any_order(order: tuple[int, ...]) -> None:
    """Closing pyrender's own would end EGL for all of the process."""
    studios = [Studio(name, STATIC, cameras=small(), modes=MODES) for name in ("opengl", "pyrender", "pyrender")]
    who = actors(PLACES)
    before = [studio.shoot(who, BODIES) for studio in studios]
    open_ones = dict(enumerate(studios))
    for closed in order:
        open_ones.pop(closed).rig.close()
        for k, studio in open_ones.items():
            assert_same(studio.shoot(who, BODIES), before[k])
        late = Studio("pyrender", STATIC, cameras=small(), modes=MODES)
        assert_same(late.shoot(who, BODIES), before[1])
        late.rig.close()


def test_one_that_is_not_closed_is_collected_without_harm() -> None:
    """Also between the strokes of another one, when that one's context is the current one."""
    opengl, forgotten = opened("opengl"), opened("pyrender")
    for renderer in (opengl, forgotten):
        renderer.update(TRIANGLE)
    expected = opengl.see(TINY, SE3.identity(), None)
    assert (forgotten.see(TINY, SE3.identity(), None).face == expected.face).all()
    with opengl._context:  # type: ignore[attr-defined]
        del forgotten, renderer
        gc.collect()
        again = opengl.see(TINY, SE3.identity(), None)
    np.testing.assert_array_equal(again.face, expected.face)
    opengl.close()


def test_a_context_of_someone_elses_stays_current(pyrender: Renderer) -> None:
    moderngl = pytest.importorskip("moderngl")
    theirs = moderngl.create_context(standalone=True, backend="egl", libgl="libOpenGL.so.0", libegl="libEGL.so.1")
    buffer = theirs.buffer(b"theirs")
    pyrender.update(TRIANGLE)
    pyrender.see(TINY, SE3.identity(), None)
    opened("pyrender").close()
    pyrender.close()
    assert buffer.read() == b"theirs"
    theirs.release()


def test_a_process_ends_well_without_closing() -> None:
    opened("pyrender").close()  # pyrender is there, or this skips
    program = """
from coopsim.sensors.camera.renderers import make_renderer
kept = [make_renderer(name) for name in ("pyrender", "opengl", "pyrender")]
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_another_platform_of_opengl_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    with pytest.raises(MissingDependencyError, match="PYOPENGL_PLATFORM must be unset or 'egl', got 'osmesa'"):
        make_renderer("pyrender")


def test_pyrender_that_was_asked_for_must_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", None)  # type: ignore[arg-type]
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[pyrender\]'.*libegl1") as raised:
        make_renderer("pyrender")
    assert isinstance(raised.value.__cause__, ImportError)
