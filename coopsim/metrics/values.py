"""Metric values by the names that users read; ratios are per cent."""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.metrics.average_precision import AP_THRESHOLDS, average_precision
from coopsim.metrics.candidate_pairs import NEAR_M
from coopsim.metrics.clear import Clear
from coopsim.metrics.hota import count_hota
from coopsim.metrics.identity import count_identity
from coopsim.metrics.matching import NumberedSequence
from coopsim.metrics.nuscenes import sweep_near
from coopsim.metrics.recall_averages import RecallSweep
from coopsim.metrics.track_log import FlatLog

NEAR = f"@{NEAR_M:g}m"
"""Ends the names of metrics that match by distance on the ground, and not by 3D IoU."""

AP_NAMES = tuple(f"AP{kind}@{threshold:g}" for kind in ("3D", "BEV") for threshold in AP_THRESHOLDS)


def average_values(sweep: RecallSweep) -> dict[str, float]:
    """AB3DMOT's averages over recall."""
    return {"sAMOTA": 100 * sweep.samota, "AMOTA": 100 * sweep.amota, "AMOTP": 100 * sweep.amotp}


def clear_values(clear: Clear) -> dict[str, float]:
    """CLEAR's ratios and counts."""
    objects = max(clear.objects, 1)
    return {
        "MOTA": 100 * clear.mota,
        "MOTP": 100 * clear.motp,
        "sMOTA": 100 * clear.smota,
        "MODA": 100 * clear.moda,
        "recall": 100 * clear.recall,
        "precision": 100 * clear.precision,
        "MT": 100 * clear.mostly_tracked / objects,
        "PT": 100 * clear.partly_tracked / objects,
        "ML": 100 * clear.mostly_lost / objects,
        "IDS": clear.ids,
        "FRAG": clear.frag,
        "TP": clear.tp,
        "FP": clear.fp,
        "FN": clear.fn,
        "GT": clear.gt,
        "objects": clear.objects,
    }


def uncut_values(flats: Sequence[FlatLog], matches: Sequence[NumberedSequence]) -> dict[str, float]:
    """What is measured on everything that was reported.

    Args:
        flats: pooled.
        matches: the same, with the pairs of a track on an object.
    """
    near = [flat.numbered(flat.nearness) for flat in flats]
    averages = sweep_near(near)
    return {
        **_hota_values([flat.numbered(flat.iou_3d) for flat in flats]),
        **_identity_values(matches),
        **_hota_values(near, NEAR),
        f"AMOTA{NEAR}": 100 * averages.amota,
        f"AMOTP{NEAR}": averages.amotp,  # m
        **_ap_values(flats),
    }


def _hota_values(sequences: Sequence[NumberedSequence], suffix: str = "") -> dict[str, float]:
    counts = count_hota(sequences)
    values = {"HOTA": counts.hota, "DetA": counts.det_a, "AssA": counts.ass_a, "LocA": counts.loc_a}
    return {name + suffix: 100 * value for name, value in values.items()}


def _identity_values(sequences: Sequence[NumberedSequence]) -> dict[str, float]:
    counts = count_identity(sequences)
    return {"IDF1": 100 * counts.f1, "IDP": 100 * counts.precision, "IDR": 100 * counts.recall}


def _ap_values(flats: Sequence[FlatLog]) -> dict[str, float]:
    overlaps = ([flat.iou_3d for flat in flats], [flat.iou_bev for flat in flats])
    values = [
        average_precision(
            [(flat.numbered(overlap, threshold), flat.score) for flat, overlap in zip(flats, kind, strict=True)]
        )
        for kind in overlaps
        for threshold in AP_THRESHOLDS
    ]
    return {name: 100 * value for name, value in zip(AP_NAMES, values, strict=True)}
