"""Describe a place, make an environment in it by name, and write it as a file that reads back equal."""

import coopsim
from coopsim.envs.simulated.scenario_file import load_scenario_file, write_scenario_file
from coopsim.world.places.description import MapBay, MapBuilding, MapLane, MapUnit, MapWays


def lay_bypass() -> coopsim.PlaceDescription:
    """Return a street of 120 m with a turning loop at each end, a crosswalk, and a parked truck before it."""
    return coopsim.PlaceDescription(
        nodes={"west_in": (-60, -2), "east_out": (60, -2), "east_in": (60, 2), "west_out": (-60, 2)},
        roads=(
            MapLane("west_in", "east_out", speed_m_s=8),
            MapLane("east_out", "east_in", turn="around"),
            MapLane("east_in", "west_out", speed_m_s=8),
            MapLane("west_out", "west_in", turn="around"),
        ),
        walks=MapWays(
            nodes={"a": (-50, -7), "b": (10, -7), "c": (50, -7), "d": (-50, 7), "e": (10, 7), "f": (50, 7)},
            ways=(("a", "b", "c"), ("d", "e", "f")),
            crosswalks=(("b", "e"),),
        ),
        parked=(MapBay((0, -5.5), 0, "truck"),),
        buildings=(MapBuilding(((-40, 12), (-10, 12), (-10, 24), (-40, 24)), 9, windows=True),),
        rsus=(MapUnit((12, 5.5), (0, 0)),),
    )


coopsim.register_place("bypass", lay_bypass)
env = coopsim.parallel_env("bypass", vehicles=5, pedestrians=6, parked=1, lidar=None, max_cycles=50)
env.reset(seed=3)
print(f"{len(env.agents)} agents: {', '.join(env.agents)}")

path = write_scenario_file("bypass.yaml", lay_bypass(), population={"vehicles": 5, "parked": 1})
assert load_scenario_file(path).scenario.description == lay_bypass()
score = coopsim.evaluate("late_fusion", "bypass.yaml", seed=3, lidar=None, max_cycles=50).score
print(f"late_fusion in {path}: MOTA {score['MOTA']:.0f}")
