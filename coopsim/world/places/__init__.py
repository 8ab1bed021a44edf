"""Built-in places: roads, scenery, and the ways of people."""
