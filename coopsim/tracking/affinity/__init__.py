"""How alike a track and a detection are: larger is always more alike."""
