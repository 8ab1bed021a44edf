"""The shapes of vehicles and people: those that are built in, made by code, and those that users add."""

from coopsim.world.models.catalogue import make_models, register_model
from coopsim.world.models.from_mesh import model_from_mesh

__all__ = ["make_models", "model_from_mesh", "register_model"]
