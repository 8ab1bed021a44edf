"""Street furniture and plants from a file."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_finite_number
from coopsim.world.custom.clearance import Kerbs
from coopsim.world.furniture.furnishing import line_pieces
from coopsim.world.furniture.kinds import KINDS, Kind

_SAMPLE_M = 1.0  # along lines; no lane is so narrow


def read_furniture(entry: Entry, kerbs: Kerbs) -> list[dict[str, Any]]:
    """Read the key `furniture` of a place: a list for `furnishing_parts`.

    Raises:
        ScenarioFileError: names the file and the line: an unknown kind or size, or furniture on a road.
    """
    items, pieces = entry.entries(), []
    spots: list[Floats] = []
    for item in items:
        if "kind" not in (named := item.named()):
            raise item.error(f"kind is missing in furniture. Accepted: {', '.join(KINDS)}")
        kind = KINDS[named["kind"].choice(KINDS, "kind of furniture")]
        piece = _read_piece(item, kind)
        pieces.append(piece)
        spots.append(_ground(piece, kind))
    if not _all_beside(spots, entry, kerbs):
        for item, points in zip(items, spots, strict=True):
            kerbs.require_beside(points, item, "furniture")
    return pieces


def _read_piece(item: Entry, kind: Kind) -> dict[str, Any]:
    required = ("kind", "along") if kind.along else ("kind", "at", "heading_deg")
    fields = item.fields(required, tuple(kind.sizes))
    piece: dict[str, Any] = {"kind": fields["kind"].text()}
    if kind.along:
        points = fields["along"].points(2)
        if not np.diff(points, axis=0).any(axis=1).all():
            raise fields["along"].error("along must lead from point to point, each another place than the one before")
        piece["along"] = points.tolist()
    else:
        piece["at"] = fields["at"].point().tolist()
        piece["heading_deg"] = float(fields["heading_deg"].checked(require_finite_number))
    for name, size in kind.sizes.items():
        if name in fields:
            piece[name] = float(fields[name].checked(require_between, size.least, size.most))
    if piece.get("stem_m", kind.sizes["stem_m"].usual if "stem_m" in kind.sizes else 0) >= piece.get("height_m", 9.0):
        raise item.error("stem_m must be less than height_m: the crown is between them")
    return piece


def _ground(piece: dict[str, Any], kind: Kind) -> Floats:
    """Return points (N, 2) m that must not be on a road."""
    if kind.along:
        points = np.array(piece["along"])
        return np.concatenate([line_pieces(points, _SAMPLE_M)[0], points])
    length, width = kind.ground_m
    heading = np.radians(piece["heading_deg"])
    ahead, left = np.array([[exact.cos(heading), exact.sin(heading)], [-exact.sin(heading), exact.cos(heading)]])
    corners = [(a * length / 2, b * width / 2) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    around = [piece["at"] + a * ahead + b * left for a, b in corners]
    return np.array([piece["at"], *around])


def _all_beside(spots: list[Floats], entry: Entry, kerbs: Kerbs) -> bool:
    """Return whether no point is on a road, in one go: a town has hundreds of pieces."""
    if not spots:
        return True
    try:
        kerbs.require_beside(np.concatenate(spots), entry, "furniture")
    except entry.kind:
        return False
    return True
