"""Drawn towns as maps of other programs. Start in `map_format`."""
