"""Samples: views of clips, with errors of poses and delays, as networks take them.

A clip, a random stream and settings come in; pillars, images, sightings or streams with their targets go out, in the
order of `sample_order`. Start reading at `cloud_samples`, then `fused_samples`.
"""
