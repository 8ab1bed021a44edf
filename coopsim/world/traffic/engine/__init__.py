"""highway-env's models of traffic, over arrays: what `coopsim.world.traffic.traffic` steps by default.

A vehicle is a row of a structured array, so that a compiled kernel takes the whole fleet as one argument. Kernels visit
vehicles one after another, as highway-env does: a driver sees the lane changes that those before it have just
decided. What is fast here is that nobody looks at everybody: neighbours come from lists sorted along each lane.
"""
