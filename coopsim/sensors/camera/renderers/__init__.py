"""What each pixel of a camera sees: by OpenGL, by ray casting, or by pyrender."""
