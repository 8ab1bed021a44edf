"""A lit crossing of SUMO with arms of 220 m, as netconvert makes it, and demands on it."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from coopsim.data.maps.netconvert import is_there, run_netconvert

needs_sumo = pytest.mark.skipif(
    find_spec("libsumo") is None or not is_there(),
    reason="libsumo or netconvert is not installed: pip install 'coopsim[sumo]'",
)
ARMS = {"e": (220, 0), "n": (0, 220), "w": (-220, 0), "s": (0, -220)}
CLASSES = {
    "passenger": "",
    "bus": "",
    "truck": "",
    "delivery": "",
    "motorcycle": "",
    "bicycle": "",
    "tram": 'length="30"',
}


def crossing(folder: Path) -> Path:
    """Write the network, in whose plane the crossing is at (1000, 500)."""
    nodes = "".join(f'<node id="{k}" x="{1000 + x}" y="{500 + y}"/>' for k, (x, y) in ARMS.items())
    both = [pair for arm in ARMS for pair in ((arm, "c"), ("c", arm))]
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2" speed="13.9" sidewalkWidth="2"/>' for a, b in both
    )
    files = {
        "node-files": f'<nodes><node id="c" x="1000" y="500" type="traffic_light"/>{nodes}</nodes>',
        "edge-files": f"<edges>{edges}</edges>",
    }
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    made = folder / "crossing.net.xml"
    options = {name: str(folder / f"{name}.xml") for name in files}
    more = {"offset.disable-normalization": "true", "crossings.guess": "true", "output-file": str(made)}
    status, lines = run_netconvert(options | more, "a network")
    assert status == 0, lines
    return made


def demand(folder: Path, begin_s: float = 0.0) -> Path:
    """Write a demand: a vehicle of each class, flows from all arms, and somebody on foot."""
    types = "".join(f'<vType id="{name}" vClass="{name}" {more}/>' for name, more in CLASSES.items())
    trips = "".join(
        f'<trip id="{name}0" type="{name}" depart="{begin_s + 3 * k}" from="wc" to="{"ce" if k % 2 else "cn"}"/>'
        for k, name in enumerate(CLASSES)
    )
    flows = "".join(
        f'<flow id="{a}" type="passenger" begin="{begin_s + 30}" end="{begin_s + 300}" period="4" '
        f'from="{a}c" to="c{b}"/>'
        for a, b in ("ew", "we", "ns", "se")
    )
    person = f'<person id="p" depart="{begin_s + 40}"><walk from="wc" to="ce"/></person>'
    path = folder / "crossing.rou.xml"
    path.write_text(f"<routes>{types}{trips}{flows}{person}</routes>")
    return path
