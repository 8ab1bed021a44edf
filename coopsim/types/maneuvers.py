"""The maneuvers that an agent can choose from when its action drives."""

MANEUVERS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Names of the discrete maneuvers, numbered as highway-env numbers its meta-actions."""

IDLE = MANEUVERS.index("idle")
"""The maneuver that changes nothing."""
