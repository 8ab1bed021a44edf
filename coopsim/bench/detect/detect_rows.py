"""Rows of the table: what was measured, pooled over episodes, as plain data for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.disturbance import Disturbance
from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.bench.detect.protocols.protocol import PROTOCOLS, Protocol
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.bench.detect.ranking.ranking_intervals import area_interval

_MAIN = "APBEV@0.5"

WITH_INTERVALS = (_MAIN, "APBEV@0.7", "AP3D@0.5", "AP3D@0.7", "APBEV@0.3 people", "APBEV@0.5 others_only")
"""Metrics for which rows have intervals."""

EVERYWHERE = "all"
"""The environment of a row that pools all environments."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """An episode, matched.

    Attributes:
        perceived: the episode.
        rankings: by metric, as the protocol makes them.
    """

    perceived: Perceived
    rankings: Mapping[str, Ranking]

    @classmethod
    def of(cls, perceived: Perceived, protocol: str, within_m: float | None = None) -> Measured:
        """Match an episode by a protocol, up to a distance of the receivers; None: everywhere."""
        looked_at = perceived if within_m is None else perceived.within(within_m)
        return cls(perceived, PROTOCOLS.get(protocol)().rankings(Overlaps.of(looked_at)))


def row_of(
    plan: DetectPlan, place: tuple[str, str, Disturbance], options: Mapping[str, Any], measured: Sequence[Measured]
) -> dict[str, Any]:
    """Return the row of a policy, an environment and a disturbance, pooled over its episodes.

    Args:
        plan: the plan.
        place: policy, environment (or `EVERYWHERE`) and disturbance.
        options: of the environment.
        measured: at least one episode.
    """
    policy, environment, disturbance = place
    protocol = PROTOCOLS.get(plan.protocol)()
    episodes, rankings = [each.perceived for each in measured], [each.rankings for each in measured]
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
        "within_m": plan.within_m,
        "arithmetic": plan.arithmetic(policy),
        "frames": sum(each.frames for each in episodes),
        "receiver_frames": sum(each.receiver_frames for each in episodes),
        "messages": messages,
        "bytes_per_message": round(sent_bytes / messages, 1) if messages else 0.0,
        **_ms(episodes),
        **metrics_of(protocol, rankings),
        "objects": sum(part[_MAIN].objects for part in rankings),
        "intervals": intervals_of(protocol, rankings),
    }


def metrics_of(protocol: Protocol, parts: Sequence[Mapping[str, Ranking]]) -> dict[str, float | None]:
    """Return the metrics of episodes together, by name; None where there was nothing to be found.

    Args:
        protocol: of the metrics.
        parts: rankings of each episode, by name.
    """
    joined = {name: Ranking.joined([part[name] for part in parts]) for name in parts[0]}
    return {name: None if math.isnan(value) else round(value, 6) for name, value in protocol.values(joined).items()}


def intervals_of(protocol: Protocol, parts: Sequence[Mapping[str, Ranking]]) -> dict[str, list[float]]:
    """Return the 95 % intervals of the main areas, by name; empty for too few episodes. Arguments: `metrics_of`."""
    pooled = protocol.ranks_frames_together
    found = {
        name: area_interval([part[name] for part in parts], pooled=pooled)
        for name in WITH_INTERVALS
        if name in parts[0]
    }
    return {name: [round(end, 6) for end in ends] for name, ends in found.items() if ends is not None}


def _ms(episodes: Sequence[Perceived]) -> dict[str, float]:
    """Return milliseconds a frame of the environment, by part."""
    frames = sum(each.frames for each in episodes)
    names = list(dict.fromkeys(name for each in episodes for name in each.ms))
    return {
        f"ms_{name}": round(sum(each.ms.get(name, 0.0) * each.frames for each in episodes) / max(frames, 1), 3)
        for name in names
    }
