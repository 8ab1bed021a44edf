"""Multi-object tracking: parts that compose to a tracker, on struct-of-arrays state."""
