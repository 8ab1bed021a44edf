"""The network of cooperating agents: from messages to a map that is warped, expanded and fused."""
