"""What a training trains: a detector, a fusion on a frozen encoder, or both together."""
