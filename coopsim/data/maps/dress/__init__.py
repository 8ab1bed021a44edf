"""What stands and lies beside the roads of a map: pavements, people's ways, houses, trees, bays, roadside units."""
