"""Networks of SUMO, with the polygons that lie beside them."""
