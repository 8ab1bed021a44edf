"""Places: roads, pavements and scenery of every scenario that comes along."""
