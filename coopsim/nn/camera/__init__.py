"""Networks that read pictures, lifted into space and seen from above.

In: `picture_batch.PictureBatch`, the pictures of several agents with their calibrations. Out: features of the same kind
as those of points. Start reading at `lift_splat`.
"""
