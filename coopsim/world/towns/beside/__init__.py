"""What stands beside a town's streets: pavements and people's ways, houses, plants, walls, masts."""
