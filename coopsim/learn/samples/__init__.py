"""Samples: views of clips, with errors of poses and delays, as networks take them."""
