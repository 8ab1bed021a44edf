"""The writer of SUMO's networks. Start in `network`."""
