"""Logs as worlds: where and when an episode is played, who is connected, and what stands around."""
