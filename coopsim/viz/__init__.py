"""Pictures of frames and models."""
