"""Losses: the distance of predictions from targets.

Raw outputs of a network and a sample's targets come in; scalars by name go out, weighted by `head_losses.WEIGHTS`.
Start reading at `head_losses`.
"""
