"""Simulated environments: a world comes in, frames go out.

Start reading in `simulation`: it steps the world, `lidar_sensing` and `equipment` sense it, `perception` detects.
Options are in `simulation_options`, files of users in `scenario_file`, recorded traffic in `record_episode`.
"""
