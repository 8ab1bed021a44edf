"""Vehicles: their starts, and two engines that move them by the same rules.

A layout, a population and a seed become a `Fleet` (`fleet.py`), which an engine steps in place. The default engine has
highway-env's models over arrays: a vehicle is a row of a structured array, so that compiled kernels take the whole
fleet as one argument. As in highway-env, kernels visit vehicles one after another, and a driver sees lane changes that
earlier ones have just decided. The speed comes from lists of bodies sorted along each lane, which replace a search
among all. Start in `traffic.py`, then `array_engine.py`; `highway_env_engine.py` steps highway-env's own objects, as a
reference.
"""
