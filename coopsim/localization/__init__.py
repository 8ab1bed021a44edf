"""Localization of agents: noise of global poses, odometry, and the covariances that agents state.

True poses come in, estimated ones with their covariances and the measured motion go out. Start with `localizer`; its
errors are in `pose_noise`, and `odometry` keeps an agent's own past in the frame in which it tracks.
"""
