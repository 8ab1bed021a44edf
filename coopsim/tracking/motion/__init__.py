"""Motion models: Kalman filters of boxes, at constant velocity and on curves."""
