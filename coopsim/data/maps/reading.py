"""Read a map of any format: the root of the file tells which."""

from __future__ import annotations

import warnings
from pathlib import Path

from coopsim.data.maps.elements import read_elements
from coopsim.data.maps.lanelet2.reader import has_lanelets, read_lanelet_map
from coopsim.data.maps.opendrive.reader import read_opendrive
from coopsim.data.maps.osm.content import Content
from coopsim.data.maps.osm.reader import read_osm
from coopsim.data.maps.street_map import StreetMap
from coopsim.data.maps.sumo.network import read_network
from coopsim.data.maps.sumo.polygons import polygons_beside, with_polygons
from coopsim.errors import MapFileError, MapWarning

_SKIPPED = ("userData", "dataQuality", "roadMark", "param")
"""Elements that are passed over, with all in them."""
_ACCEPTED = (
    "accepted: OpenDRIVE 1.4 to 1.8 (.xodr), SUMO networks (.net.xml), OpenStreetMap and Lanelet2 (.osm), plain or in "
    "gzip (.gz)"
)


def read_map(path: str | Path) -> StreetMap:
    """Read a map; of a network of SUMO also the polygons `x.poly.xml` that lie beside `x.net.xml`.

    What can be repaired is, with a `MapWarning` for each kind of fault.

    Raises:
        MapFileError: the file is missing, broken or of another format; names file, line and element.
        MissingDependencyError: a map of OpenStreetMap needs SUMO's netconvert, and it is not there.
    """
    file = Path(path)
    elements = read_elements(file, _SKIPPED)
    root = next(elements, None)
    if root is None:
        raise MapFileError(f"{file} is empty; {_ACCEPTED}")
    if root.tag == "OpenDRIVE":
        found = read_opendrive(file, root, elements)
    elif root.tag == "net":
        found, beside = read_network(file, root, elements), polygons_beside(file)
        found = found if beside is None else with_polygons(found, beside)
    elif root.tag == "osm":
        content = Content(root, elements)
        found = read_lanelet_map(file, content) if has_lanelets(content) else read_osm(file, content)
    else:
        raise root.error(f"is no road map; {_ACCEPTED}")
    for line in found.repaired:
        warnings.warn(f"{file}: {line}", MapWarning, stacklevel=2)
    return found
