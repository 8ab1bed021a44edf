"""Maps of OpenStreetMap: roads by SUMO's netconvert, and what stands beside them from the file itself.

Lanes, junctions and lights are not in such files. netconvert guesses them from tags, as nobody else does so well; its
programs run apart, so its licence (EPL-2.0 or GPL-2.0) does not touch ours. Houses are read here, not by SUMO's
polyconvert: that drops barriers, trees and levels, and the file is read and checked before another program gets it.
"""
