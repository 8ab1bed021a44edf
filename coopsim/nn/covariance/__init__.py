"""A learned covariance for every box, and the Kalman filter through which it learns (DMSTrack)."""
