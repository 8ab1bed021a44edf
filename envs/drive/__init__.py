"""Driving along routes, for learners: `coopsim/drive-v1`, one car in gymnasium's API, several in PettingZoo's.

No sensors, messages or tracks: a step is that of the world, and of the observation of what is near. Read `parallel`
first, then `observation`, `outcome` and `reward`; `single` is the same for one car, and
`planned` has planners drive it.
"""
