"""Uplinks: the messages that agents make of their observations. Importing registers them."""

from coopsim.comms.uplinks import share_detections, share_features, share_points, share_tracks

__all__ = ["share_detections", "share_features", "share_points", "share_tracks"]
