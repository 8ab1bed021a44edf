"""pyrender draws the cameras (`renderer="pyrender"`): the reference of the other renderers."""
