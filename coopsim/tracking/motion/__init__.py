"""How objects move: Kalman filters and motion models."""
