"""Encoders of identity: from points or pictures of an object to a unit vector that tells it from others.

In: points in boxes, or crops of pictures. Out: vectors for `Detections.embedding`. Start reading at `point_encoder`.
"""
