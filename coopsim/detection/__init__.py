"""Detection: boxes from an agent's sensor data, by networks or simulated on the truth, and embeddings of detections.

Input is a `SensorView` (and, for simulated detectors alone, an `Oracle`); output is `Detections` in the agent's base
frame. Start with `detector.py`, the interface; `presets.py` lists the detectors by name.
"""
