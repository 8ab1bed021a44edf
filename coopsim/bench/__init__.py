"""Running policies and reporting how they did."""
