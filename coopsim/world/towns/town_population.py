"""The usual numbers of vehicles, people and agents of a town."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population

MOST = Population(
    vehicles=30,
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

FEWEST = Population(vehicles=9, truck_share=0.1, pedestrians=0, connected_cars=3, rsus=2, drones=4)
"""At least so many are usual in every town, and (roadside units and drones) have a place there."""

FEWEST_STARTS = 20
"""Every town has at least so many starts for vehicles."""

MOVING = ("motorcycles", "buses", "vans", "vehicles")

MOST_TOGETHER = ((MOVING, 500), (("parked",), 150), (("pedestrians", "children", "bicycles", "scooters"), 4000))
"""No town takes more on its roads, at its kerbs and on its pavements. Of 30 with nine junctions and three lanes the
largest has room for 434, 110 and 2,922."""

_ALWAYS, _PER_JUNCTION = 5, 3.2  # vehicles: with more of them, some wait at junctions for half a minute
_JUNCTION_M = 36.0  # around the middle of a junction: the middles of its movements
_PER_VEHICLE_M = 80.0  # of lanes, at least
_LEAST = 9  # vehicles: of every three, one starts in the order of connection, so the three usual agents do
_PER_WALKER_M = 45.0  # of pavements; footways hold one person on every two metres
_PARKED_SHARE = 0.7  # of bays
_FREE_SHARE = 0.6  # of starts: no more are taken


def usual_population(layout: Layout) -> Population:
    """Return the numbers that go with a town's junctions, the length of its pavements, and its bays and masts."""
    lanes_m = sum(lane.length for lane in layout.network.lanes.values())
    vehicles = round(min(_ALWAYS + _PER_JUNCTION * count_junctions(layout), lanes_m / _PER_VEHICLE_M))
    vehicles = min(max(vehicles, _LEAST), int(_FREE_SHARE * len(layout.slots)), MOST.vehicles)
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


def count_junctions(layout: Layout) -> int:
    """Return the number of places where more than two ways cross or join: where lanes join, there are two."""
    lanes = [layout.network.get_lane((*road, 0)) for road in layout.movements]
    middles = np.array([lane.position(lane.length / 2, 0.0) for lane in lanes]).reshape(-1, 2)
    count = 0
    while len(middles):
        near = exact.norm(middles - middles[0], axis=1) < _JUNCTION_M
        near = exact.norm(middles - middles[near].mean(axis=0), axis=1) < _JUNCTION_M
        near[0] = True
        count += int(near.sum() > 2)
        middles = middles[~near]
    return count
