"""Traffic that another program drives while an episode runs: SUMO, through libsumo. Start in `scenarios`."""
