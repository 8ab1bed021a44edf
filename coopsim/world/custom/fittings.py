"""Bays for parked vehicles and roadside units from a file."""

from __future__ import annotations

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3
from coopsim.support.checks import require_finite_number
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.clearance import Kerbs
from coopsim.world.places.layout import Bay

_BESIDE_M = 3.0  # from the middle of a lane to the middle of a parked vehicle
_PARKED = {label.title: label for label in ObjectClass if label not in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)}


def read_bay(entry: Entry, kerbs: Kerbs) -> Bay:
    """Return a bay beside the roads."""
    fields = entry.fields(("at", "heading_deg"), ("label",))
    at = fields["at"].point()
    kerbs.require_beside(at[None], fields["at"], "at", _BESIDE_M)
    heading_deg = float(fields["heading_deg"].checked(require_finite_number))
    label = _PARKED[fields["label"].choice(_PARKED)] if "label" in fields else None
    return Bay(float(at[0]), float(at[1]), float(np.radians(heading_deg)), label)


def read_unit(entry: Entry, kerbs: Kerbs) -> SE3:
    """Return `world_SE3_base` of a roadside unit beside the roads."""
    fields = entry.fields(("at", "look_at"))
    at, ahead = fields["at"].point(), fields["look_at"].point() - fields["at"].point()
    kerbs.require_beside(at[None], fields["at"], "at")
    if not ahead.any():
        raise fields["look_at"].error("look_at must be another place than at")
    return SE3.from_xyz_yaw([*at, 0.0], float(exact.arctan2(ahead[1], ahead[0])))
