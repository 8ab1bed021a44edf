"""Fusion of the boxes and tracks of several agents.

Detections or tracks of each agent, in one frame, come in; one set without duplicates goes out, or corrected poses of
the senders. Start with `pooling`, the late fusion of the field's baselines; each other file is one method.
"""
