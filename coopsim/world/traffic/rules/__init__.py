"""Rules of traffic that both engines share."""
