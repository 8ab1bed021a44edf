"""Places that users describe in a YAML file: `coopsim.world.custom.place` has the keys."""
