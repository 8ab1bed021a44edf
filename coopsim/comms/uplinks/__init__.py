"""Uplinks: what an agent broadcasts of what it observes. Importing registers them."""

from coopsim.comms.uplinks import share_detections, share_features, share_points, share_tracks

__all__ = ["share_detections", "share_features", "share_points", "share_tracks"]
