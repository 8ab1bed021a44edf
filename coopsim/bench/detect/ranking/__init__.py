"""What protocols share: overlaps of detections with objects, ranked hits and misses, and intervals of areas."""
