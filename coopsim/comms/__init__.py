"""V2X: what agents send each other, and what happens to it on the way."""
