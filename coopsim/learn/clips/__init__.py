"""Clips: consecutive scenes of one episode as plain arrays, without torch, from the simulator or from recordings.

A `WorldRecipe` or folders of recordings come in; a `ClipSource` goes out, whose clips may be cached in a folder
(`store`) and made ahead by other processes (`ahead`). Start reading at `clip`, then `sources`.
"""
