"""Renderers, which find what each pixel of a camera sees: OpenGL, ray casting, and pyrender as their reference."""
