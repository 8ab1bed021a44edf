"""Weights of networks that come along: `NAME.safetensors`, each with its card `NAME.json`. Data only, no code.

`make weights` makes them anew, and `coopsim.learn.weights` loads them.
"""
