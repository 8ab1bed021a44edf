"""OpenDRIVE 1.4 to 1.8, from a road's plan view to ways over junctions."""
