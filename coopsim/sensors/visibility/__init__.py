"""How well each actor could be seen, is seen, and what hides it: for training and analysis."""
