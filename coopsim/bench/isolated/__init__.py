"""Policies in processes of their own, which get observations and nothing else."""
