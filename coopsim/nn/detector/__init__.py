"""Network of one agent: pillars, encoder, and heads that find boxes.

In: points. Out: features of a grid, and detections. Start reading at `detector_net`.
"""
