"""The choice of a renderer by name. OpenGL is fast, ray casting does without it, pyrender is the reference of both."""

from __future__ import annotations

import warnings

from coopsim.errors import MissingDependencyError
from coopsim.sensors.camera.renderer import Renderer
from coopsim.sensors.camera.renderers.opengl import OpenGLRenderer
from coopsim.sensors.camera.renderers.pyrender_reference.pyrender_renderer import PyrenderRenderer
from coopsim.sensors.camera.renderers.raycast_renderer import RaycastRenderer
from coopsim.support.checks import require_choice

RENDERERS = ("auto", "opengl", "raycast", "pyrender")


def resolved_renderer(name: str) -> str:
    """Return which renderer `make_renderer` makes on this machine: a name other than "auto"."""
    if name != "auto":
        return name
    try:
        OpenGLRenderer().close()
    except MissingDependencyError:
        return "raycast"
    return "opengl"


def make_renderer(name: str) -> Renderer:
    """Make the renderer called `name`; "auto" is OpenGL if it works, else ray casting, with one warning.

    Raises:
        UnknownNameError: no such renderer.
        MissingDependencyError: "opengl" or "pyrender" was asked for and does not work here; says what to install.
    """
    require_choice("renderer", name, RENDERERS)
    if name == "raycast":
        return RaycastRenderer()
    if name == "pyrender":
        return PyrenderRenderer()
    try:
        return OpenGLRenderer()
    except MissingDependencyError as error:
        if name == "opengl":
            raise
        warnings.warn(f"cameras are ray-cast, which is slower: {error}", stacklevel=2)
        return RaycastRenderer()
