"""Networks at work: from points to messages and detections, quickly and without gradients."""
