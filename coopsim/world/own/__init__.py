"""Places that users describe in a YAML file: `coopsim.world.own.place` has the keys."""
