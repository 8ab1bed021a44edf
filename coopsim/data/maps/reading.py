"""Read a map of any format: the root of the file tells which."""

from __future__ import annotations

import warnings
from pathlib import Path

from coopsim.data.maps.elements import read_elements
from coopsim.data.maps.opendrive.reader import read_opendrive
from coopsim.data.maps.street_map import StreetMap
from coopsim.data.maps.sumo.network import read_network
from coopsim.data.maps.sumo.polygons import polygons_beside, with_polygons
from coopsim.errors import MapFileError, MapWarning

_SKIPPED = ("userData", "dataQuality", "roadMark", "param")
"""Elements that are passed over, with all in them."""
_ACCEPTED = "accepted: OpenDRIVE 1.4 to 1.8 (.xodr) and SUMO networks (.net.xml), plain or in gzip (.gz)"
_CONVERT = "of the first, SUMO's `netconvert --osm-files FILE -o FILE.net.xml` makes a network"


def read_map(path: str | Path) -> StreetMap:
    """Read a map; of a network of SUMO also the polygons `x.poly.xml` that lie beside `x.net.xml`.

    What can be repaired is, with a `MapWarning` for each kind of fault.

    Raises:
        MapFileError: the file is missing, broken or of another format; names file, line and element.
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
        raise root.error(f"is a map of OpenStreetMap or Lanelet2; {_CONVERT}; {_ACCEPTED}")
    else:
        raise root.error(f"is no road map; {_ACCEPTED}")
    for line in found.repaired:
        warnings.warn(f"{file}: {line}", MapWarning, stacklevel=2)
    return found
