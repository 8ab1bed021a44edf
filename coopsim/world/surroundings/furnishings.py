"""The furnishings of places, by name. Importing registers them."""

from coopsim.world.furniture.furnish import furnished_for
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import FURNISHINGS
from coopsim.world.surroundings.clutter import cluttered
from coopsim.world.surroundings.street import street_for


@FURNISHINGS.register("furniture")
def furniture(identity: str, layout: Layout, population: Population) -> Layout:
    """Add furniture, which depends on the identity alone."""
    return furnished_for(identity, layout)


@FURNISHINGS.register("street")
def street(identity: str, layout: Layout, population: Population) -> Layout:
    """Add the surroundings of a street; vehicles rest in its bays unless the population parks there."""
    return street_for(identity, layout, park=not population.parked)


FURNISHINGS.register("clutter")(cluttered)
