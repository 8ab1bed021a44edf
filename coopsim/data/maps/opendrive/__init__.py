"""OpenDRIVE 1.4 to 1.8, from a road's plan view to ways over junctions.

Libraries were weighed. `pyxodr` 0.1.3 (MIT; needs lxml, matplotlib, rich, scipy, Shapely) has plan views, lanes and
junctions, but no superelevation, lateral shapes, signals or objects. `omega-prime` 0.3.7 (MPL-2.0) builds on it, with
20 packages more. SUMO's `netconvert` drops objects and lane kinds, and gives each lane one width; it serves as a second
reading to compare with.
"""
