"""Traffic by highway-env's own classes (`traffic="highway-env"`): slow, and a check of the array engine."""
