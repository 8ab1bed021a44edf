"""pyrender in a separate OpenGL context, which leaves other contexts of the process alone.

This imports pyrender, and so OpenGL: import it only if pyrender was asked for and `PYOPENGL_PLATFORM` is "egl".
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyrender
from OpenGL import EGL
from OpenGL.error import GLError
from pyrender.platforms.egl import EGLPlatform

_SHADERS = Path(__file__).parent / "pyrender_shaders"


class Context(EGLPlatform):  # type: ignore[misc]  # pyrender is untyped
    """A context whose deletion ends only itself; pyrender's ends the display, with every context of the process."""

    _egl_display: Any
    _egl_context: Any

    def __init__(self) -> None:
        super().__init__(1, 1)  # drawing goes to a framebuffer of any size
        before = EGL.eglGetCurrentContext()
        self.init_context()
        self._make_current(before)

    @contextmanager
    def current(self) -> Iterator[None]:
        """Make this the current context, and afterwards the one that was current before."""
        before = EGL.eglGetCurrentContext()
        self.make_current()
        try:
            yield
        finally:
            self._make_current(before)

    def delete_context(self) -> None:
        if self._egl_context is not None:
            EGL.eglDestroyContext(self._egl_display, self._egl_context)
            self._egl_context = None

    def _make_current(self, context: Any) -> None:
        nowhere = (self._egl_display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE)
        try:
            EGL.eglMakeCurrent(*nowhere, context)
        except GLError:  # it was released while it was current, as moderngl does
            EGL.eglMakeCurrent(*nowhere, EGL.EGL_NO_CONTEXT)


class TriangleRenderer(pyrender.Renderer):  # type: ignore[misc]
    """pyrender's renderer with a segmentation pass that writes triangles' numbers instead of nodes' colours."""

    def __init__(self) -> None:
        super().__init__(1, 1)
        self._program_cache.shader_dir = str(_SHADERS)

    def __del__(self) -> None:
        # pyrender's version deletes by number, in whatever context is current when the garbage is collected.
        pass
