"""Clips: what a training learns from as plain arrays; in files, in folders, and made ahead by other processes."""
