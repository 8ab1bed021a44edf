"""Shapes of vehicles and people: meshes for each pose, with materials.

Start in `model.py`; `catalogue.py` has all models: the built-in ones, which `built_in.py` reads, and custom ones, as
from meshes.
"""

from coopsim.world.models.catalogue import make_models, register_model
from coopsim.world.models.from_mesh import model_from_mesh
from coopsim.world.models.model import Model

__all__ = ["Model", "make_models", "model_from_mesh", "register_model"]
