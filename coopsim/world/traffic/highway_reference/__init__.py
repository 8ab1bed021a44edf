"""highway-env's own objects step the traffic (`traffic="highway-env"`): the reference of the fast engine."""
