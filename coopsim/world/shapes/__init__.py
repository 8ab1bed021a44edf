"""Built-in shapes of vehicles and people, made by code. Importing registers them.

Tables of sizes and parts become `coopsim.world.models.Model`s: a mesh for each pose, with materials. Start in
`parts.py`, from which `cars.py`, `heavy.py`, `riders.py` and `pedestrians.py` build.
"""

from coopsim.world.models.catalogue import SHAPES
from coopsim.world.models.model import Model
from coopsim.world.shapes.cars import make_cars, make_vans, make_varied_cars
from coopsim.world.shapes.heavy import make_buses, make_trucks, make_varied_buses, make_varied_trucks
from coopsim.world.shapes.pedestrians import make_adults, make_children, make_varied_people
from coopsim.world.shapes.people_at_rest import make_people_at_rest
from coopsim.world.shapes.riders import make_bicycles, make_motorcycles, make_scooters, make_varied_riders


@SHAPES.register("plain")
def make_plain() -> tuple[Model, ...]:
    """Make the models of all places, by class."""
    return (
        *make_cars(),
        *make_vans(),
        *make_trucks(),
        *make_buses(),
        *make_motorcycles(),
        *make_bicycles(),
        *make_scooters(),
        *make_adults(),
        *make_children(),
    )


@SHAPES.register("varied")
def make_varied() -> tuple[Model, ...]:
    """Make the variants of them."""
    return (
        *make_varied_cars(),
        *make_varied_trucks(),
        *make_varied_buses(),
        *make_varied_riders(),
        *make_varied_people(),
    )


SHAPES.register("at_rest")(make_people_at_rest)
