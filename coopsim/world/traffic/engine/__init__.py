"""highway-env's traffic models over arrays: the default engine.

A vehicle is a row of a structured array, so that compiled kernels take the whole fleet as one argument. As in
highway-env, kernels visit vehicles one after another, and a driver sees lane changes that earlier ones have just
decided. The speed comes from lists of bodies sorted along each lane, which replace a search among all.
"""
