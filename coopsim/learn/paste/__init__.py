"""Simulated actors in real sweeps: labelled clips from logs without labels.

`coopsim.learn.paste.paste` begins the reading: sweeps, rays, ground, actors, returns, files.
"""
