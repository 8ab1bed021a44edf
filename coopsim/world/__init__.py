"""The simulated world: places, traffic, people, and recordings of them."""
