"""Instance queries: objects as vectors of features that agents decode, send, match, fuse and carry over frames."""
