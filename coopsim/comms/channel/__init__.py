"""Channel: latency, loss, bandwidth and clocks."""
