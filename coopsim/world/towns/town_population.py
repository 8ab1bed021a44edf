"""The usual numbers of vehicles, people and agents of a town."""

from __future__ import annotations

from coopsim.world.places.layout import Layout
from coopsim.world.population import Population

MOST = Population(
    vehicles=40,
    truck_share=0.1,
    vans=4,
    buses=1,
    motorcycles=2,
    pedestrians=40,
    children=6,
    bicycles=8,
    scooters=4,
    parked=60,
    connected_cars=3,
    rsus=2,
)
"""At most so many are usual in any town."""

FEWEST = Population(vehicles=12, truck_share=0.1, pedestrians=0, connected_cars=3, rsus=2, drones=4)
"""At least so many are usual in every town, and (roadside units and drones) have a place there."""

FEWEST_STARTS = 20
"""Every town has at least so many starts for vehicles."""

_PER_VEHICLE_M = 95.0  # of lanes
_LEAST = 12  # vehicles
_PER_WALKER_M = 45.0  # of pavements; footways hold one person on every two metres
_PARKED_SHARE = 0.7  # of bays
_FREE_SHARE = 0.6  # of starts: no more are taken


def usual_population(layout: Layout) -> Population:
    """Return the numbers that go with the length of a town's lanes and pavements, and its bays and masts."""
    lanes_m = sum(lane.length for lane in layout.network.lanes.values())
    vehicles = min(max(round(lanes_m / _PER_VEHICLE_M), _LEAST), int(_FREE_SHARE * len(layout.slots)), MOST.vehicles)
    more = vehicles // 10
    pavements_m = 0.0 if layout.footways is None else layout.footways.capacity * 2.0
    pedestrians = min(round(pavements_m / _PER_WALKER_M), MOST.pedestrians)
    wheels = 0 if layout.footways is None and layout.cycleways is None else 1 + vehicles // 6
    return Population(
        vehicles=vehicles,
        truck_share=MOST.truck_share,
        vans=min(more, MOST.vans),
        buses=0,
        motorcycles=min(more // 2, MOST.motorcycles),
        pedestrians=pedestrians,
        children=min(pedestrians // 6, MOST.children),
        bicycles=min(wheels, MOST.bicycles),
        scooters=min(wheels // 2, MOST.scooters),
        parked=min(int(_PARKED_SHARE * len(layout.bays)), MOST.parked),
        connected_cars=min(MOST.connected_cars, vehicles // 2),
        rsus=min(MOST.rsus, len(layout.rsus)),
    )
