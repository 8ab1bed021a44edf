"""A benchmark's store: finished cells, by what decided them."""
