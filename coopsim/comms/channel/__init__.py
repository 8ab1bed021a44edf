"""The channel: latency, loss, bandwidth, clocks."""
