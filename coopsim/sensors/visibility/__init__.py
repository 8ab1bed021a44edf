"""Visibility of each actor to each agent, and what hides it: for training and analysis."""
