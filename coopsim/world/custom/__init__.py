"""Custom places: roads, ways and scenery from scenario files."""
