"""Shapes of vehicles and people, made by code: what `make_actors.py` writes into the file that coopsim reads.

Tables of sizes and parts become `coopsim.world.models.Model`s: a mesh for each pose, with materials. Start in
`parts.py`, from which `cars.py`, `heavy.py`, `riders.py` and `pedestrians.py` build.
"""

from actor_shapes.cars import make_cars, make_vans, make_varied_cars
from actor_shapes.heavy import make_buses, make_trucks, make_varied_buses, make_varied_trucks
from actor_shapes.pedestrians import make_adults, make_children, make_varied_people
from actor_shapes.people_at_rest import make_sitting_people, make_standing_people
from actor_shapes.riders import make_bicycles, make_motorcycles, make_scooters, make_varied_riders
from coopsim.world.models.model import Model


def make_actors() -> dict[str, list[Model]]:
    """Return all built-in models by group: those of all places, by class; their variants; people at rest."""
    plain = [make_cars, make_vans, make_trucks, make_buses, make_motorcycles, make_bicycles, make_scooters]
    plain += [make_adults, make_children]
    varied = [make_varied_cars, make_varied_trucks, make_varied_buses, make_varied_riders, make_varied_people]
    return {
        "plain": [model for make in plain for model in make()],
        "varied": [model for make in varied for model in make()],
        "standing": make_standing_people(),
        "sitting": make_sitting_people(),
    }
