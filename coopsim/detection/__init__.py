"""From what sensors return to boxes."""
