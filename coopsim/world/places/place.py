"""A place with its usual population."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from coopsim.support.registry import Registry
from coopsim.world.places.description import PlaceDescription
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A place with its usual population.

    Attributes:
        name: name of the scenario.
        make_layout: builds the layout.
        population: its usual numbers.
        description: it was built from this; None: the place is built in.
    """

    name: str
    make_layout: Callable[[], Layout]
    population: Population
    description: PlaceDescription | None = field(default=None, repr=False)  # of hundreds of lines


BUILDERS: Registry[Callable[[PlaceDescription, str], Place]] = Registry(
    "builder of places", home="coopsim.world.custom.place"
)
"""Functions that build a place of a description and a name: "described"."""
