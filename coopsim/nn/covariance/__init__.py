"""Learned covariance of every box, and the Kalman filter through which it learns (DMSTrack).

In: boxes with scores and, if the network reads features, patches of the detecting agent's map. Out: their variances.
Start reading at `covariance_net`.
"""
