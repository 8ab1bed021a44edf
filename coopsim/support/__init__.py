"""Ground that everything stands on: checked arrays and values, files, random streams, registries, threads."""
