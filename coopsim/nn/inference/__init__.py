"""Networks in use, without gradients: on any device and in either arithmetic.

In: `SensorView`s. Out: features (`encoders`) on cells of the world (`canvas`), or detections (`detectors`).
Start reading at `encoders`; `backend` says on which device and in which numbers.
"""
