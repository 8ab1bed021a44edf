"""What policies perceived: episodes run at a pace, timed by parts, and kept in files."""
