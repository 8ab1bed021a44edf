"""Encoders of identity: from what a sensor shows of an object to a unit vector that tells it from others."""
