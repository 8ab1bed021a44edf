"""How far messages are received, by scene, sight, scheme and size.

Run by `make bench`. Nothing here fails by its figures; they are printed, and stand in `docs/reference/channel.md`.
"""

import numpy as np
import pytest

from coopsim.comms.radio.obstruction import RadioScene
from coopsim.comms.radio.radio_config import Radio
from coopsim.comms.radio.reception import RadioReception
from coopsim.geometry.boxes import Boxes3D

DISTANCES_M = (50, 100, 150, 200, 300, 400, 600, 800, 1000)
SIZES_BYTES = (350, 3500)
EPISODES = 400


def between(state: str, distance_m: float) -> RadioScene:
    """Two cars with a truck, a wall or nothing halfway between them."""
    antennas = {"a": np.array([0.0, 0.0, 1.6]), "b": np.array([distance_m, 0.0, 1.6])}
    truck = Boxes3D.from_array([[distance_m / 2, 0.0, 1.9, 8.0, 2.5, 3.8, 0.0]])
    wall = np.array([[[distance_m / 2, -5.0], [distance_m / 2, 5.0]]])
    if state == "LOS":
        return RadioScene(antennas)
    return RadioScene(antennas, {}, truck, np.array([1])) if state == "NLOSv" else RadioScene(antennas, walls=wall)


@pytest.mark.parametrize("scene", ["urban", "highway"])
def test_delivery_by_distance(scene: str) -> None:
    print(f"\n{scene}, % delivered, at m: {' '.join(map(str, DISTANCES_M))}")
    for state in ("LOS", "NLOSv", "NLOS"):
        for mcs in (4, 7, 11):
            radio = Radio(scene, mcs=mcs)  # type: ignore[arg-type]
            for size in SIZES_BYTES:
                reached = []
                for distance_m in DISTANCES_M:
                    around = between(state, distance_m)
                    chances = [
                        RadioReception(radio, seed).reception_probabilities({"a": size}, around)["a", "b"]
                        for seed in range(EPISODES)
                    ]
                    reached.append(100 * float(np.mean(chances)))
                print(f"{state} mcs {mcs} {size} bytes: {' '.join(f'{share:.0f}' for share in reached)}")
