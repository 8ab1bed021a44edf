"""Detection measured: average precision of what policies perceive, by the protocols of the field."""
