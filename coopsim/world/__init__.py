"""Traffic, people and scenery: what there is to sense."""
