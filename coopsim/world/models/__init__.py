"""Shapes of vehicles and people: built-in ones, made by code, and custom ones from meshes."""

from coopsim.world.models.catalogue import make_models, register_model
from coopsim.world.models.from_mesh import model_from_mesh
from coopsim.world.models.model import Model

__all__ = ["Model", "make_models", "model_from_mesh", "register_model"]
