"""The ground's relief: kerbs, crowned roads, humps, and surfaces that lie on them.

Outlines of pavements and middles of roads come in; triangles go out, and `Relief`, which reads heights off them.
"""
