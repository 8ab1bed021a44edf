"""Rows as a Markdown table. Brackets hold the 95 % interval over episodes, where there are enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tabulate import tabulate

_ABOUT = ("policy", "environment", "noise", "delay_ms")
_NUMBERS: dict[str, tuple[str, ...]] = {
    "coopsim": (
        "APBEV@0.3", "APBEV@0.5", "APBEV@0.7", "AP3D@0.5", "AP3D@0.7", "APBEV@0.3 people", "APBEV@0.5 others_only",
        "recall others_only", "recall", "false_per_frame",
    ),
    "opencood": ("APBEV@0.3", "APBEV@0.5", "APBEV@0.7"),
    "dair": ("AP3D@0.3", "AP3D@0.5", "AP3D@0.7", "APBEV@0.3", "APBEV@0.5", "APBEV@0.7"),
    "nuscenes": ("mAP", "mAP@0.5m", "mAP@1m", "mAP@2m", "mAP@4m"),
    "v2x-real": ("APBEV@0.5 Vehicle", "APBEV@0.5 Truck", "APBEV@0.5 Pedestrian", "mAPBEV@0.3", "mAPBEV@0.5"),
}  # fmt: skip
_COSTS = ("frames", "bytes_per_message", "ms_environment", "ms_uplink", "ms_policy")


def markdown_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows of one protocol as a Markdown table; columns in which no row has anything are left out."""
    if not rows:
        return "no results"
    protocol, within_m = str(rows[0]["protocol"]), rows[0].get("within_m")
    numbers = _NUMBERS.get(protocol, tuple(name for name in rows[0] if name.startswith(("AP", "mAP"))))
    shown = [name for name in (*_ABOUT, *numbers, *_COSTS) if any(row.get(name) is not None for row in rows)]
    cells = [[_with_interval(row, name) for name in shown] for row in rows]
    align = ["left" if name in _ABOUT else "right" for name in shown]
    table = tabulate(cells, headers=shown, tablefmt="github", colalign=align, disable_numparse=True)
    near = "" if within_m is None else f", within {within_m:g} m of the receiver"
    used = {row["arithmetic"] for row in rows if row.get("arithmetic")}
    computed = f", networks multiply in {' or '.join(sorted(used))}" if used else ""
    return f"protocol {protocol}{near}{computed}\n\n{table}"


def _cell(name: str, value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if name in ("frames", "bytes_per_message", "delay_ms"):
        return f"{value:,.0f}"
    return f"{value:.1f}" if name.startswith("ms_") else f"{value:.3f}"


def _with_interval(row: Mapping[str, Any], name: str) -> str:
    low_high = row.get("intervals", {}).get(name)
    return _cell(name, row.get(name)) + ("" if low_high is None else f" ({low_high[0]:.2f}-{low_high[1]:.2f})")
