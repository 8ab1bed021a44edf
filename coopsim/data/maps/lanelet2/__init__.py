"""Maps of Lanelet2 (`.osm` with relations of type lanelet), read as its documents say.

The libraries `lanelet2` (31 MB) and `simple-lanelet2` (3 MB) give borders and the lanelets that follow, but neither
junctions nor ways over them, which is most of the work. Files would pass by the checks and bounds of our reader of XML.
"""
