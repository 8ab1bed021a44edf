"""Network of cooperating agents: from messages to a map that is warped, expanded and fused.

In: `inference.encoders.SensedFrame` and other agents' `FeatureMap`s. Out: fused features and detections. Start reading
at `perceiver`, which calls the rest in the order of a frame.
"""
