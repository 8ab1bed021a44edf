"""Multi-object tracking by detection, of exchangeable parts that work on all tracks at once.

Detections come in, in a frame that does not move with the agent, from any number of agents and late ones too; tracks
with lasting ids go out. Start with `ab3dmot_tracker`, a tracker composed of the parts, and `tracker`, its step.
"""
