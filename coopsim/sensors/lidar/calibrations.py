"""Beam angles of two real LiDARs in degrees, from the calibrations that came with the units.

A data sheet gives the first and the last beam; a unit's calibration gives all, and no two units have the same. Beams
are from top to bottom. All are assumed to start in one point: the calibrations' offsets of a few centimetres (in the
HDL-64E up to 0.22 m upwards) and their corrections of range are left out.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats


def _numbers(text: str) -> Floats:
    return np.array(text.split(), dtype=np.float64)


# A Velodyne HDL-64E S3: `vert_correction` and `rot_correction` of params/64e_s3-xiesc.yaml in the ROS driver velodyne
# (since 2018, pull request 205), also the default of MRPT; to 0.001 degrees. As in the manual, the upper 32 beams are
# 1/3 degree apart and the lower 32 beams 1/2 degree. The driver subtracts rot_correction from a clockwise angle, so it
# is counted to the left.
HDL_64E_ELEVATION_DEG = _numbers("""
    1.96 1.562 1.293 0.895 0.591 0.204 -0.089 -0.452 -0.756 -1.143 -1.459 -1.81 -2.091 -2.488 -2.792 -3.119 -3.469
    -3.819 -4.157 -4.53 -4.809 -5.135 -5.483 -5.889 -6.19 -6.56 -6.849 -7.23 -7.552 -7.943 -8.219 -8.563 -8.775 -9.3
    -9.744 -10.176 -10.754 -11.295 -11.913 -12.294 -12.83 -13.163 -13.806 -14.291 -14.927 -15.385 -15.906 -16.274
    -16.801 -17.368 -17.964 -18.429 -18.923 -19.247 -19.892 -20.429 -21.064 -21.491 -21.976 -22.358 -22.966 -23.549
    -24.147 -24.555
""")
HDL_64E_LEFT_DEG = _numbers("""
    2.109 -0.11 -2.172 -4.388 5.683 3.441 1.334 -0.89 -2.94 -5.184 6.385 4.162 2.147 -0.107 -2.123 -4.34 5.613 3.405
    1.371 -0.871 -2.907 -5.133 6.485 4.214 2.191 -0.055 -2.253 -4.382 5.676 3.412 1.39 -0.876 2.899 -0.342 -3.685 -6.933
    8.335 5.073 1.664 -1.572 -4.884 -8.3 9.67 6.277 3.004 -0.39 -3.675 -7.112 8.521 5.178 1.824 -1.626 -4.989 -8.521
    9.944 6.538 3.11 -0.291 -3.812 -7.326 8.903 5.48 1.818 -1.613
""")

# An Ouster OS1-128, calibrated in 2022 (serial number 122246000293): `beam_altitude_angles` and `beam_azimuth_angles`
# of its metadata in the tests of Ouster's SDK (tests/metadata/3_0_1_os-122246000293.json, 2023). They span 42.4
# degrees, as in the data sheet of rev. 7, but 0.74 degrees lower; the beams are in four columns, 8 firings of 1024
# apart. The SDK subtracts the azimuths from a counter-clockwise angle, so they are counted clockwise.
OS1_128_ELEVATION_DEG = _numbers("""
    20.47 20.21 19.89 19.54 19.23 18.97 18.66 18.31 18 17.72 17.4 17.05 16.74 16.45 16.13 15.77 15.45 15.15 14.83 14.47
    14.15 13.85 13.52 13.17 12.83 12.52 12.19 11.83 11.5 11.18 10.85 10.5 10.14 9.82 9.49 9.14 8.79 8.45 8.13 7.76 7.42
    7.08 6.75 6.39 6.04 5.7 5.35 5 4.64 4.32 3.98 3.61 3.25 2.92 2.57 2.22 1.85 1.52 1.17 0.82 0.45 0.12 -0.24 -0.58
    -0.95 -1.28 -1.64 -1.97 -2.35 -2.69 -3.03 -3.37 -3.74 -4.1 -4.43 -4.77 -5.14 -5.49 -5.82 -6.17 -6.53 -6.88 -7.22
    -7.55 -7.91 -8.27 -8.6 -8.92 -9.28 -9.64 -9.97 -10.29 -10.65 -11.01 -11.33 -11.64 -12.01 -12.35 -12.69 -12.98 -13.34
    -13.69 -14.03 -14.32 -14.68 -15.02 -15.35 -15.63 -15.98 -16.34 -16.65 -16.93 -17.27 -17.63 -17.93 -18.21 -18.55
    -18.9 -19.2 -19.48 -19.81 -20.16 -20.46 -20.72 -21.05 -21.39 -21.68 -21.95
""")
OS1_128_CLOCKWISE_DEG = _numbers("""
    4.2 1.42 -1.37 -4.14 4.22 1.44 -1.37 -4.15 4.24 1.43 -1.36 -4.15 4.24 1.43 -1.36 -4.16 4.23 1.42 -1.37 -4.17 4.25
    1.43 -1.37 -4.16 4.24 1.42 -1.38 -4.18 4.24 1.42 -1.38 -4.18 4.24 1.41 -1.38 -4.18 4.23 1.41 -1.39 -4.19 4.22 1.4
    -1.39 -4.2 4.21 1.4 -1.4 -4.2 4.2 1.41 -1.4 -4.21 4.2 1.4 -1.41 -4.21 4.2 1.4 -1.41 -4.21 4.2 1.4 -1.42 -4.21 4.2
    1.4 -1.42 -4.22 4.2 1.39 -1.41 -4.22 4.2 1.38 -1.41 -4.23 4.2 1.38 -1.41 -4.24 4.2 1.39 -1.42 -4.23 4.2 1.38 -1.43
    -4.22 4.2 1.38 -1.42 -4.23 4.19 1.38 -1.42 -4.23 4.2 1.39 -1.43 -4.22 4.2 1.38 -1.42 -4.23 4.19 1.39 -1.43 -4.24
    4.19 1.38 -1.43 -4.23 4.2 1.38 -1.42 -4.24 4.2 1.38 -1.43 -4.24 4.19 1.37 -1.43 -4.24 4.19 1.37 -1.44 -4.25
""")
