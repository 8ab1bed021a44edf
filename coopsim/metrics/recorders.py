"""The recorders that come along, of which metrics read the records."""

from coopsim.episode import RECORDERS
from coopsim.metrics.deception_log import DeceptionRecorder
from coopsim.metrics.drive_log import DriveRecorder
from coopsim.metrics.scorer import TrackRecorder
from coopsim.metrics.trust_log import TrustRecorder

TRACKS = "tracks"
"""Name of the recorder that every score needs."""

RECORDERS.register(TRACKS)(TrackRecorder)
RECORDERS.register("drives")(DriveRecorder)
RECORDERS.register("trust")(TrustRecorder)
RECORDERS.register("deceptions")(DeceptionRecorder)
