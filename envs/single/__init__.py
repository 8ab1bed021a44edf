"""One agent acts, as gymnasium has it; the others follow given policies."""
