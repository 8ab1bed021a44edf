"""From sensor data to boxes: detectors (real and simulated) and embedders."""
