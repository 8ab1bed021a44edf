"""Fusions of several agents' feature maps, one file each. Importing registers them."""
