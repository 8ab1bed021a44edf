"""Localization of agents: noise of global poses, odometry, and the covariances that agents state."""
