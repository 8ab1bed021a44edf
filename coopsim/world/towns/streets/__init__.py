"""The streets of a town: where junctions lie, what roads join them, their lanes and kerbs, and where agents start."""
