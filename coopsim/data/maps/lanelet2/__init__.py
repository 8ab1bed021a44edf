"""Maps of Lanelet2 (`.osm` with relations of type lanelet), read as its documents say.

The library `lanelet2` needs Boost and ROS's wheels and raises without an element or a line; `simple-lanelet2` is young.
Both give borders and follow-up lanelets, but neither junctions nor ways over them, which is most of the work.
"""
