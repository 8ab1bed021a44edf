"""Data of others, converted to our frames and orders at this edge only: files come in, or go out.

Start in `recordings` (sweeps), `recording_set` (detections in text files) or `export` (folders to write).
"""

from coopsim.support.moved import moved

moved(f"{__name__}.opencood", "coopsim.learn.opencood")
