"""Rows of the table: what was measured, pooled over episodes, as plain data for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from coopsim.bench.detect.detect_plan import DetectPlan, Disturbance
from coopsim.bench.detect.overlaps import Overlaps
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols.protocol import PROTOCOLS, Protocol
from coopsim.bench.detect.ranking import Ranking

EVERYWHERE = "all"
"""The environment of a row that pools all environments."""


def row_of(
    plan: DetectPlan, place: tuple[str, str, Disturbance], options: Mapping[str, Any], episodes: Sequence[Perceived]
) -> dict[str, Any]:
    """Return the row of a policy, an environment and a disturbance, pooled over its episodes.

    Args:
        plan: the plan.
        place: policy, environment (or `EVERYWHERE`) and disturbance.
        options: of the environment.
        episodes: at least one.
    """
    policy, environment, disturbance = place
    protocol = PROTOCOLS.get(plan.protocol)()
    messages, sent_bytes = sum(each.messages for each in episodes), sum(each.sent_bytes for each in episodes)
    return {
        "policy": policy,
        "environment": environment,
        "protocol": plan.protocol,
        "noise": disturbance.noise,
        "delay_ms": disturbance.delay_ms,
        "options": dict(options),
        "seeds": list(plan.seeds),
        "receivers": plan.receivers,
        "boxes": plan.boxes,
        "frames": sum(each.frames for each in episodes),
        "receiver_frames": sum(each.receiver_frames for each in episodes),
        "messages": messages,
        "bytes_per_message": round(sent_bytes / messages, 1) if messages else 0.0,
        **_ms(episodes),
        **metrics_of(protocol, episodes),
    }


def metrics_of(protocol: Protocol, episodes: Sequence[Perceived]) -> dict[str, float | None]:
    """Return the metrics of episodes together, by name; None where there was nothing to be found."""
    parts = [protocol.rankings(Overlaps.of(each)) for each in episodes]
    joined = {name: Ranking.joined([part[name] for part in parts]) for name in parts[0]}
    return {name: None if math.isnan(value) else round(value, 6) for name, value in protocol.values(joined).items()}


def _ms(episodes: Sequence[Perceived]) -> dict[str, float]:
    """Return milliseconds a frame of the environment, by part."""
    frames = sum(each.frames for each in episodes)
    names = list(dict.fromkeys(name for each in episodes for name in each.ms))
    return {
        f"ms_{name}": round(sum(each.ms.get(name, 0.0) * each.frames for each in episodes) / max(frames, 1), 3)
        for name in names
    }
