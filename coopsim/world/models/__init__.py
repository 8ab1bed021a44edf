"""Shapes of vehicles and people: built-in ones, made by code, and custom ones from meshes.

Tables of sizes and parts become `Model`s: a mesh for each pose, with materials. Start in `model.py`, then `parts.py`,
from which `cars.py`, `heavy.py`, `riders.py` and `pedestrians.py` build; `catalogue.py` has all of them.
"""

from coopsim.world.models.catalogue import make_models, register_model
from coopsim.world.models.from_mesh import model_from_mesh
from coopsim.world.models.model import Model

__all__ = ["Model", "make_models", "model_from_mesh", "register_model"]
