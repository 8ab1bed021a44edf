"""The ground's relief: kerbs, crowned roads, humps, and what lies on them."""
