"""Exports as nuScenes' tables, and results of policies for its official tools."""
